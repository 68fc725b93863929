"""Signals in memory, compared at one level of operation."""

import numpy as np

from tbm_gsa.comparison.offline import compare_signals, compared_band
from tbm_gsa.signals.clock import sampling_rate
from tbm_gsa.signals.conditioning import ZeroPhaseConditioner
from tbm_gsa.signals.reduction import SignalReducer
from tbm_gsa.signals.settings import Settings


def reduced(time, values, rate, band, frame, settings):
    reducer = SignalReducer(rate, band, frame, settings)
    reducer.feed(time - time[0], values)
    return reducer.finish()


def compared(field, model, frame="fixed", settings=None):
    """Compare (time (n,), values (n, 3)) of field and model."""
    chosen = settings or Settings()
    rates = [round(sampling_rate(time), 3) for time, _ in (field, model)]  # the nominal ones
    band = compared_band(*rates, chosen)
    sides = [reduced(*signal, rate, band, frame, chosen) for signal, rate in zip((field, model), rates, strict=True)]
    return compare_signals(*sides, chosen)


def uniform(values, rate, start=0.0):
    """Times of uniform samples, and the samples."""
    return start + np.arange(len(values)) / rate, values


def segments(time, values, rate, band, cuts=(), block=np.inf):
    """Conditioned with zero phase, in pieces that end at `cuts`."""
    conditioner = ZeroPhaseConditioner(rate, band, block)
    pieces = zip(np.split(time, cuts), np.split(values, cuts), strict=True)
    return [*(segment for piece in pieces for segment in conditioner.feed(*piece)), *conditioner.finish()]


def conditioned(time, values, rate, band):
    """Conditioned accelerations, (n, 3)."""
    return np.concatenate([segment.acceleration for segment in segments(time, values, rate, band)])
