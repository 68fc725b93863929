"""Signals: clock, filters, windows, spectra, statistics and their intervals."""
