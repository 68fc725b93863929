"""Calibration of the values of a machine file that have no source: `python -m tbm_dynamics.calibration`."""
