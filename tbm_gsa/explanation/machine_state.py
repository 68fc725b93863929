"""What single input of the machine has changed, and to what value, from the chart of what is left for the machine.

Along every input, at values that are even in the space of its distribution, the model says how the logarithms of the
band powers move at the level of the loads that was just found. What the level of the loads leaves of these moves is
averaged as the residuals are, so that the chart's mean and covariance hold for every value: its likelihood. Half of the
prior weight is on nothing, half even on the inputs. An input that the sensors do not see keeps its prior.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg

from tbm_gsa.explanation.cause_curves import CauseCurves
from tbm_gsa.explanation.rock_fit import RockFit, RockModel
from tbm_gsa.explanation.sequential import MachineChart
from tbm_gsa.sensitivity.study.inputs import Input
from tbm_msgs_py.base.arrays import Array

VALUES: Final = 21
"""Of every input."""
NOTHING: Final = 0.5
"""Prior probability that nothing has changed."""
_ENDS: Final = (0.05, 0.5, 0.95)
_FELT: Final = 1e-300
_BETWEEN: Final = 5


@dataclass(frozen=True)
class InputState:
    """What is known of an input if it alone has changed.

    Attributes
    ----------
    name : str
        Code of the input.
    value, low, high : float
        Median and 90 % interval, in the input's unit.
    probability : float
        That it is this one that has changed; the remainder is with the others and with nothing.
    rest : float
        Distance of the chart that its most likely value leaves.
    """

    name: str
    value: float
    low: float
    high: float
    probability: float
    rest: float


@dataclass(frozen=True, eq=False)
class CauseGrid:
    """Band powers along inputs; i inputs, v even places of their distributions, r groups of loads, k statistics.

    Attributes
    ----------
    inputs : tuple of Input
    gain : ndarray, shape (i, v, r, k)
    meshes : ndarray, shape (i, v, k)
    """

    inputs: tuple[Input, ...]
    gain: Array
    meshes: Array

    @classmethod
    def of(cls, curves: CauseCurves) -> CauseGrid:
        """From the curves of a machine."""
        unit = np.linspace(0.0, 1.0, VALUES)
        found = [curves.powers_along(code, unit) for code in curves.tables]
        return cls(
            tuple(curves.inputs[code] for code in curves.tables),
            np.array([gain for gain, _ in found]),
            np.array([meshes for _, meshes in found]),
        )

    def moves(self, model: RockModel, fit: RockFit) -> Array:
        """Differences (i, v, k) of the logarithms of band powers from the commissioned machine's, at a fit's loads."""
        powers = np.einsum("r,ivrk->ivk", np.exp(2.0 * fit.log_factors), self.gain)
        powers += self.meshes + model.scatter.width * model.noise
        return np.asarray(np.log(np.maximum(powers, _FELT)) - model.expected(fit))


class MachineState:
    """Single causes beside a chart, span by span.

    Parameters
    ----------
    model : RockModel
    grid : CauseGrid
    chart : MachineChart
        Whose spans are added here after they were added there.
    """

    def __init__(self, model: RockModel, grid: CauseGrid, chart: MachineChart) -> None:
        self._model, self._grid, self._chart = model, grid, chart
        self._moves = np.zeros(grid.meshes.shape)

    def add(self, fit: RockFit) -> None:
        """Add the span that the chart has just got."""
        new = self._chart.weight
        self._moves = (1.0 - new) * self._moves + new * self._grid.moves(self._model, fit) @ fit.left.T

    def inputs(self, spans: float = np.inf) -> tuple[InputState, ...]:
        """Return what is known of every input, in the order of the grid, if the change began so many spans ago."""
        share = 1.0 - (1.0 - self._chart.weight) ** spans  # of the chart's weight, on spans after the change
        root = scipy.linalg.cholesky(self._chart.covariance, lower=True)
        nothing = scipy.linalg.solve_triangular(root, self._chart.mean, lower=True)
        moves = scipy.linalg.solve_triangular(root, self._moves.reshape(-1, len(root)).T, lower=True).T
        off = nothing - share * _finer(moves.reshape(self._moves.shape))
        distance, before = np.square(off).sum(axis=2), float(nothing @ nothing)
        least = min(before, float(distance.min()))
        each, nothing_else = np.exp(-0.5 * (distance - least)), float(np.exp(-0.5 * (before - least)))
        evidence = (1.0 - NOTHING) / len(each) * each.mean(axis=1)
        found = evidence / (NOTHING * nothing_else + evidence.sum())
        return tuple(
            self._one(item, row, float(probability), float(rest))
            for item, row, probability, rest in zip(self._grid.inputs, each, found, distance.min(axis=1), strict=True)
        )

    def _one(self, item: Input, likelihood: Array, probability: float, rest: float) -> InputState:
        density = np.maximum(likelihood, _FELT)
        area = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
        places = np.interp(_ENDS, area / area[-1], np.linspace(0.0, 1.0, len(area)))
        low, value, high = (float(one) for one in item.distribution.from_unit(places))
        return InputState(item.code, value, low, high, probability, rest)


def _finer(values: Array) -> Array:
    """Values (i, v, k) and those between them on straight lines, (i, (v - 1) · _BETWEEN + 1, k)."""
    place = np.linspace(0.0, values.shape[1] - 1.0, (values.shape[1] - 1) * _BETWEEN + 1)
    first = np.minimum(place.astype(int), values.shape[1] - 2)
    share = (place - first)[:, None]
    return np.asarray((1.0 - share) * values[:, first] + share * values[:, first + 1])
