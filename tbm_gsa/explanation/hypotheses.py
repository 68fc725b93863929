"""What may stand behind a recording: the rock alone, one input of the machine, one sensor, or what nobody has named.

Each is a family of band powers along one place from 0 to 1, uniform beforehand; the level of the loads is free in all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal

import numpy as np
import scipy.stats

from tbm_gsa.explanation.cause_curves import CauseCurves
from tbm_gsa.explanation.load_posterior import LoadPosterior
from tbm_gsa.explanation.load_scatter import LoadScatter
from tbm_gsa.explanation.result import Fault, Verdict
from tbm_msgs_py.base.arrays import Array

Kind = Literal["nothing", "input", "unknown"] | Fault
VERDICTS: Final[tuple[Verdict, ...]] = ("rock", "machine", "sensor", "not explained")
VERDICT_OF: Final[dict[Kind, Verdict]] = {
    "nothing": "rock",
    "input": "machine",
    "gain": "sensor",
    "dead": "sensor",
    "noise": "sensor",
    "unknown": "not explained",
}
GAIN_SIGMA: Final = math.log(2.0)
"""Standard deviation of the logarithm of a gain, cut off at three of them."""
LEAST_EXCESS: Final = 3.0
"""Of the density of the noise that is found over what is expected: with less no sensor has too much."""
UNKNOWN_RANGE: Final = (0.15, 2.0)
"""Standard deviation by which an unknown change moves the logarithm of every band power; as likely in each decade."""
LEAST_MOVE: Final = 2.0
"""Standard deviations by which an input must move what is used, somewhere in its range, to be told at all."""
_LOOKED: Final = np.linspace(0.0, 1.0, 9)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One of them.

    Attributes
    ----------
    kind : Kind
    name : str
        Code of the input, or channel; empty of the others.
    at : callable
        Maps a place 0 to 1 to the machine and its sensors, and to the standard deviation (k,) of a band power's
        logarithm beside chance.
    places : bool
        Whether it has places at all.
    """

    kind: Kind
    name: str
    at: Callable[[float], tuple[LoadScatter, Array]]
    places: bool = True


def hypotheses(
    curves: CauseCurves, inputs: Sequence[str], channels: Sequence[str], excess: Array, model_error: float
) -> list[Hypothesis]:
    """Everything that is looked at.

    Parameters
    ----------
    curves : CauseCurves
        Of the k statistics that are used.
    inputs : sequence of str
        Codes of those that can be told.
    channels : sequence of str
        Of the k statistics.
    excess : ndarray, shape (k,)
        Density of the noise that was found over what is expected.
    model_error : float
        Standard deviation of a band power's logarithm that the model is wrong by in any case.
    """
    own, names = np.full(len(channels), model_error), np.array(channels)
    still = curves.nominal
    found = [
        Hypothesis("nothing", "", lambda _: (still, own), places=False),
        Hypothesis("unknown", "", lambda place: (still, np.hypot(own, _between(UNKNOWN_RANGE, place)))),
        *(Hypothesis("input", code, partial(_changed, curves, code, model_error)) for code in inputs),
    ]
    for channel in dict.fromkeys(channels):
        here = names == channel
        found += [
            Hypothesis("gain", channel, partial(_off, still, here, own)),
            Hypothesis("dead", channel, partial(_dead, still, here, own), places=False),
        ]
        ratio = float(excess[here].max())
        if ratio >= LEAST_EXCESS:
            found.append(Hypothesis("noise", channel, partial(_noisy, still, here, own, ratio), places=False))
    return found


def _changed(curves: CauseCurves, code: str, model_error: float, place: float) -> tuple[LoadScatter, Array]:
    return curves.along(code, place), np.hypot(model_error, curves.error(code))


def _off(still: LoadScatter, here: Array, error: Array, place: float) -> tuple[LoadScatter, Array]:
    return with_gain(still, here, gain_at(place)), error


def _dead(still: LoadScatter, here: Array, error: Array, _place: float) -> tuple[LoadScatter, Array]:
    return with_gain(still, here, 0.0), error


def _noisy(still: LoadScatter, here: Array, error: Array, ratio: float, _place: float) -> tuple[LoadScatter, Array]:
    return with_noise(still, here, ratio), error


def gain_at(place: float) -> float:
    """Gain of a sensor at a place of its prior."""
    reach = scipy.stats.norm.cdf(3.0)
    return float(np.exp(GAIN_SIGMA * scipy.stats.norm.ppf(1.0 - reach + place * (2.0 * reach - 1.0))))


def _between(ends: tuple[float, float], place: float) -> float:
    low, high = ends
    return float(low * (high / low) ** place)


def with_gain(scatter: LoadScatter, here: Array, gain: float) -> LoadScatter:
    """Return what sensors show if those of some statistics (k,) have a gain; their noise is as it was."""
    factor = np.where(here, gain**2, 1.0)
    return scatter.scaled(factor * np.ones_like(scatter.transfer.gain), factor, np.ones_like(factor))


def with_noise(scatter: LoadScatter, here: Array, factor: float) -> LoadScatter:
    """Return what sensors show if those of some statistics (k,) have a factor on the density of their noise."""
    ones = np.ones(len(scatter.width))
    return scatter.scaled(np.ones_like(scatter.transfer.gain), ones, np.where(here, factor, 1.0))


def influence(curves: CauseCurves, code: str, found: LoadPosterior, noise: Array) -> float:
    """Return the standard deviations by which an input moves the statistics, somewhere in its range.

    Of the machine as it stands with the loads as found (`used` all statistics); what the loads could do as well does
    not count.
    """
    factors, size = found.factors, found.covariance
    before = curves.nominal.expected(factors, noise)
    slope = 2.0 * np.square(factors)[:, None] * curves.nominal.transfer.gain / before
    # Loads that are not learnt are as wide as their posterior leaves them before this recording: wide.
    spread = found.scatter + slope.T @ np.diag(np.diag(size) / np.maximum(1.0 - found.learnt, 1e-3)) @ slope
    inverse = np.linalg.inv(spread)
    moves = [np.log(curves.along(code, place).expected(factors, noise) / before) for place in _LOOKED]
    return float(np.sqrt(max(move @ inverse @ move for move in moves)))
