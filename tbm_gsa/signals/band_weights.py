"""How much of a power at a frequency a band of a reading shows: conditioning, and the leakage of Hann segments."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from tbm_gsa.signals.conditioning import Band, power_gain
from tbm_msgs_py.base.arrays import Array

_BORDER = 0.25  # bins by which a limit may be missed, as in the bands of a window
_REACH = 20  # bins from a frequency beyond which its leakage, 1e-8 of it, is left out
_FINER = 256  # places of a bin in a table, between which 1e-5 of the share is missed
_PLACES = 4  # of a power within a bin, over which leakage is averaged


def band_weights(
    frequency: Array, band: Band, rate_hz: float, bands: Sequence[tuple[float, float]], segment_s: float
) -> Array:
    """Return the mean square that bands of a reading show of signals of unit power at single frequencies.

    A band is the sum of the bins of Hann segments, whose spectral window at a distance of ν bins is
    (sin πν / πν / (1 − ν²))² (Harris, "On the use of windows for harmonic analysis with the discrete Fourier
    transform", Proceedings of the IEEE 66 (1978) 51–83), here over its sum over all bins, 3/2.

    Parameters
    ----------
    frequency : ndarray, shape (f,)
        Hz.
    band : Band
        Of the conditioning.
    rate_hz : float
        Sampling rate.
    bands : sequence of (float, float)
        Hz.
    segment_s : float
        Length of a segment.

    Returns
    -------
    ndarray, shape (b, f)
    """
    places = frequency * segment_s
    limits = _limits(bands, segment_s)
    shares = np.array([_from_bin(places - first) - _from_bin(places - end) for first, end in limits])
    return np.asarray(shares * power_gain(rate_hz, band, frequency))


def leakage(bands: Sequence[tuple[float, float]], segment_s: float) -> Array:
    """Return the share of the power in one band that Hann segments show in another, however far off.

    Parameters
    ----------
    bands : sequence of (float, float)
        Hz.
    segment_s : float
        Length of a segment.

    Returns
    -------
    ndarray, shape (b, b)
        Rows show, columns hold the power, at any frequency of theirs with equal chance; zero on the diagonal.
    """
    limits = _limits(bands, segment_s)
    bins = np.arange(limits[:, 0].min(), limits[:, 1].max())
    inside = (bins >= limits[:, :1]) & (bins < limits[:, 1:])
    shares = np.empty((len(limits), len(limits)))
    for column, (low, high) in enumerate(np.array(bands) * segment_s):
        count = max(1, round(_PLACES * (high - low)))
        places = low + (np.arange(count) + 0.5) * ((high - low) / count)
        shares[:, column] = inside @ _shown(places[:, None] - bins).mean(axis=0)
    np.fill_diagonal(shares, 0.0)
    return shares


def _limits(bands: Sequence[tuple[float, float]], segment_s: float) -> Array:
    """First bin of each band and the first behind it, (b, 2)."""
    return np.ceil(np.array(bands) * segment_s - _BORDER)


def _shown(apart: Array) -> Array:
    """Share of a power that a bin shows at a distance, in bins."""
    window = np.sinc(apart) + 0.5 * (np.sinc(apart - 1.0) + np.sinc(apart + 1.0))
    return np.asarray(np.square(window) / 1.5)


def _from_bin(distance: Array) -> Array:
    """Share of a power that falls into a bin and all above it, (f,), from its distance to that bin."""
    return np.asarray(np.interp(distance, *_table(), left=0.0, right=1.0))


@cache
def _table() -> tuple[Array, Array]:
    """Distances of a power to a bin, in bins, and its share in that bin and all above it."""
    distance = np.arange(-_REACH * _FINER, _REACH * _FINER + 1, dtype=np.float64) / _FINER
    apart = distance[:, None] - np.arange(2 * _REACH)
    return distance, _shown(apart).sum(axis=1)
