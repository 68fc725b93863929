"""A few seconds of a recording beside the model, conditioned alike."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tbm_gsa.arrays import Array
from tbm_gsa.comparison.conditioning import Band, Conditioned, condition
from tbm_gsa.comparison.offline import Record

SAMPLES_A_PERIOD = 5  # of the highest frequency; more cannot be seen


@dataclass(frozen=True, eq=False)
class Series:
    """A stretch of one signal: time (n,) in s from its own start, values (n,) in m/s²."""

    time: Array
    values: Array


@dataclass(frozen=True, eq=False)
class Excerpt:
    """Axial acceleration of one test point; the two signals are not simultaneous, their loads differ."""

    point: str
    field: Series
    model: Series


def take_excerpt(
    point: str, record: Record, computed: tuple[ArrayLike, ArrayLike], model_rate_hz: float, band: Band, seconds: float
) -> Excerpt:
    """Cut `seconds`, or what there is, out of the middle of the longest stretch of each signal.

    Parameters
    ----------
    point : str
    record : Record
        The measured acceleration.
    computed : (array_like, array_like)
        The computed one: time (m,) s and acceleration (m, 3) m/s².
    model_rate_hz : float
    band : Band
        What both are conditioned to.
    seconds : float
    """
    measured = condition(record.time, record.values, record.rate_hz, band)
    predicted = condition(*computed, model_rate_hz, band)
    return Excerpt(point, _middle(measured, band, seconds), _middle(predicted, band, seconds))


def _middle(signal: Conditioned, band: Band, seconds: float) -> Series:
    values = max((segment.values for segment in signal.segments), key=len)[:, 0]
    count = min(len(values), round(seconds * signal.rate_hz))
    first = (len(values) - count) // 2
    stride = max(1, int(signal.rate_hz / (SAMPLES_A_PERIOD * band.high)))
    cut = values[first : first + count : stride]
    return Series(np.arange(len(cut), dtype=np.float64) * (stride / signal.rate_hz), cut)
