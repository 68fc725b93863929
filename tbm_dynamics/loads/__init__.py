"""The six load components on the cutterhead (N, N·m) as a pure function of (seed, time)."""

NOISE_HZ = 512  # of the white noise behind the spectra; here, for who asks for no more need not compile
NOISE_BLOCK = 8192  # samples of it in a block, 16 s
