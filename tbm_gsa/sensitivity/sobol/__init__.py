"""Sobol indices: in closed form for a surrogate, by sampling for any function, over conditional Kriging paths."""
