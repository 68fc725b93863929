"""Calibration of the values of a machine file that no source gives: `python -m tbm_dynamics.calibration`."""
