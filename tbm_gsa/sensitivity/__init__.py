"""Sensitivity: studies, surrogates, Sobol indices, screening."""
