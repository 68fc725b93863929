"""The six load components on the cutterhead (N, N·m) as a pure function of (seed, time)."""
