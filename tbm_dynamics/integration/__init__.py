"""Time integration of the full nonlinear system."""

DEFAULT_STEP = 1e-4
"""Time step (s) of a machine whose meshes need no shorter one; here, for who asks for no more need not compile."""

LOAD_RAMP = 0.2
"""How long the fluctuation of the loads takes to come in, s: set in at once it would strike the machine."""
