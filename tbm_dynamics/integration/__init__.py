"""Time integration of the full nonlinear system."""

DEFAULT_STEP = 1e-4  # s; here, for who asks for no more than this need not compile
