"""From shifts and facts to ranked causes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tbm_gsa.explanation.causes import Cause, Misfit, rank_causes
from tbm_gsa.explanation.observed import Observed
from tbm_gsa.explanation.shifts import Lengths, Shifts, chance
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_msgs_py.base.arrays import Array


def first_input(causes: Sequence[Cause]) -> Cause:
    """Give the most probable cause that is an input."""
    return next(cause for cause in causes if cause.place >= 0)


@dataclass(frozen=True, eq=False)
class Judge:
    """Judges causes with what the loads' chance does, which runs that differ in the loads only tell.

    Attributes
    ----------
    evaluate : MachineEvaluation
    inputs : InputSet
    facts : Observed
    lengths : Lengths
    seeds : range
        Of the loads of those runs.
    model_error : float
        Standard deviation of the logarithm of a statistic that the model is wrong by in any case.
    """

    evaluate: MachineEvaluation
    inputs: InputSet
    facts: Observed
    lengths: Lengths
    seeds: range
    model_error: float

    def causes(self, shifts: Shifts, nominal: Array) -> tuple[Misfit, list[Cause]]:
        """Rank the causes, then again with what chance does where the first of them puts the machine."""
        still = self._at(nominal)
        misfit = self._misfit(shifts, still, still)
        best, point = first_input(rank_causes(shifts, nominal, misfit)), nominal.copy()
        point[best.place] = best.quantiles[0]
        misfit = self._misfit(shifts, still, self._at(point))
        return misfit, rank_causes(shifts, nominal, misfit)

    def _at(self, point: Array) -> Array:
        """Statistics (r, k) at a point (d,) of the unit cube."""
        sample = self.inputs.sample(self.inputs.from_unit(point[None])[0])
        return np.array([statistics_of(replace(self.evaluate, seed=seed), sample) for seed in self.seeds])

    def _misfit(self, shifts: Shifts, still: Array, moved: Array) -> Misfit:
        """Take the correlations of chance from runs; its sizes are no less than the comparison's intervals say."""
        found = chance(still, moved, self.lengths)
        size = np.sqrt(np.diag(found))
        widened = np.maximum(size, [statistic.deviation for statistic in self.facts.statistics]) / size
        observed_logs = np.array([statistic.log_ratio for statistic in self.facts.statistics])
        own = self.model_error**2 * np.eye(len(size))
        return Misfit(observed_logs, shifts.error + found * np.outer(widened, widened) + own)


def statistics_of(evaluate: MachineEvaluation, sample: dict[str, float]) -> Array:
    """Run the model: the outputs of the evaluation, (k,)."""
    found = evaluate(sample)
    return np.array([found[name] for name in evaluate.outputs])
