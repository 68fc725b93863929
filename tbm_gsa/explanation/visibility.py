"""The smallest changes of a machine and its loads that can be found in band powers, in the units of a document."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from tbm_dynamics.loads.description import LOAD_GROUPS, LoadFactors
from tbm_gsa.explanation.detection import Detection
from tbm_gsa.explanation.observability_result import ObservedInput, ObservedLoad
from tbm_gsa.sensitivity.study.inputs import Input, InputSet
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

STEP: Final = 1.1
"""Factor on an input to either side, for the slopes."""
FALSE_RATE: Final = 0.05
"""Share of recordings of an unchanged machine in which any input is accused."""
PROBABILITY: Final = 0.9
"""With which a change is to be found."""
FACTOR_REACH: Final = 3.0
"""Standard deviations of its logarithm by which a load's factor may move."""


@dataclass(frozen=True, eq=False)
class Visibility:
    """What band powers say of changes; n inputs, r groups of loads.

    Attributes
    ----------
    items : InputSet
    prior : LoadFactors
    changes, known_loads : Detection
        Of the inputs, with the level of the loads free, and known.
    smallest : ndarray, shape (n,)
        Smallest changes of the logarithms that are found.
    smallest_factors : ndarray, shape (r,)
        Of the loads.
    """

    items: InputSet
    prior: LoadFactors
    changes: Detection
    known_loads: Detection
    smallest: Array
    smallest_factors: Array

    @classmethod
    def of(
        cls,
        items: InputSet,
        prior: LoadFactors,
        slopes: Array,
        chance: Array,
        loads: Array,
        false_rate: float = FALSE_RATE,
        probability: float = PROBABILITY,
    ) -> Self:
        """From slopes of the logarithms of u band powers over those of inputs (n, u) and of loads (r, u).

        `chance` (u, u) is the covariance of the first.
        """
        changes = Detection.of(slopes, chance, loads, prior.log_sigma)
        return cls(
            items,
            prior,
            changes,
            Detection.of(slopes, chance, loads[:0], prior.log_sigma),
            changes.smallest(false_rate, probability),
            _each_load(loads, chance, prior.log_sigma).smallest(false_rate, probability),
        )

    def inputs(self) -> dict[str, ObservedInput]:
        """Return what is seen of the inputs, by code."""
        return {item.code: self._input(place, item) for place, item in enumerate(self.items.inputs)}

    def _input(self, place: int, item: Input) -> ObservedInput:
        decrease, increase = _both_ways(
            float(self.smallest[place]), math.log(item.initial / item.lower), math.log(item.upper / item.initial)
        )
        known = float(self.known_loads.information[place])
        return ObservedInput(
            name=item.name,
            unit=item.unit,
            value=item.initial,
            decrease=decrease,
            increase=increase,
            hidden_by_loads=1.0 - float(self.changes.information[place]) / known if known else math.nan,
        )

    def loads(self) -> dict[str, ObservedLoad]:
        """Return what is seen of the factors of the loads, by group."""
        reach = FACTOR_REACH * self.prior.log_sigma
        found: dict[str, ObservedLoad] = {}
        for group, change in zip(LOAD_GROUPS, self.smallest_factors.tolist(), strict=True):
            decrease, increase = _both_ways(change, reach, reach)
            found[group] = ObservedLoad(value=getattr(self.prior, group), decrease=decrease, increase=increase)
        return found


def step_ends(item: Input) -> tuple[float, float]:
    """Values of an input a step less and more, within its range.

    Raises
    ------
    InputError
        A range that is not positive: changes are relative.
    """
    if item.lower <= 0.0:
        raise InputError(f"input {item.code}: range from {item.lower:g}, allowed: positive values")
    return max(item.lower, item.initial / STEP), min(item.upper, item.initial * STEP)


def _each_load(loads: Array, chance: Array, sigma: float) -> Detection:
    """Return that of each group of loads while the others are free, of slopes (r, u)."""
    rows = [
        Detection.of(loads[[place]], chance, np.delete(loads, place, axis=0), sigma).moves
        for place in range(len(loads))
    ]
    return Detection(np.concatenate(rows))


def _both_ways(change: float, down: float, up: float) -> tuple[float, float]:
    """Relative decrease and increase that a logarithm's change is; NaN where it does not reach so far."""
    decrease = -math.expm1(-change) if change <= down else math.nan
    return decrease, math.expm1(change) if change <= up else math.nan
