"""Time integration of the full nonlinear system."""
