"""Time integration of the full nonlinear system."""

DEFAULT_STEP = 1e-4  # s; here, for who asks for no more than this need not compile

LOAD_RAMP = 0.2
"""How long the fluctuation of the loads takes to come in, s: set in at once it would strike the machine."""
