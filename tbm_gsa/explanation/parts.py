"""The parts of an explanation in the units of its document, from a judgement."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from tbm_dynamics.loads.description import LOAD_GROUPS
from tbm_gsa.explanation.evidence import Finding
from tbm_gsa.explanation.hypotheses import VERDICT_OF, gain_at
from tbm_gsa.explanation.joint import InputsPosterior
from tbm_gsa.explanation.judgement import Judgement
from tbm_gsa.explanation.load_scatter import LoadScatter
from tbm_gsa.explanation.observability_result import Observable
from tbm_gsa.explanation.result import (
    ComparedStatistic,
    InputCause,
    Joint,
    JointInput,
    LoadLevel,
    Misfits,
    NoChange,
    SensorState,
)
from tbm_gsa.explanation.visibility import FALSE_RATE, PROBABILITY, Visibility, step_ends
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_msgs_py.base.arrays import Array

_ENDS: Final = (0.05, 0.5, 0.95)


def checked_powers(found: Judgement, evaluate: MachineEvaluation) -> Array:
    """Band powers (k,) of a run of the model with what the verdict stands for, its sensors' noise added."""
    chosen = found.chosen
    sample = dict(zip((f"loads.{group}" for group in LOAD_GROUPS), map(float, chosen.factors()[0]), strict=True))
    if chosen.hypothesis.kind == "input":
        law = found.curves.inputs[chosen.hypothesis.name].distribution
        sample[chosen.hypothesis.name] = float(law.from_unit(chosen.quantiles[1]))
    outputs = evaluate(sample)
    powers = np.square([outputs[name] for name in evaluate.outputs])
    if VERDICT_OF[chosen.hypothesis.kind] == "sensor":  # which the model's run does not have
        quiet, factors = np.zeros_like(powers), chosen.factors()[0]
        powers = powers * (_middle(chosen).expected(factors, quiet) / found.curves.nominal.expected(factors, quiet))
    return np.asarray(powers + _middle(chosen).width * found.bands.noise)


def _middle(chosen: Finding) -> LoadScatter:
    return chosen.hypothesis.at(float(chosen.quantiles[1]))[0]


@dataclass(frozen=True, eq=False)
class ExplanationParts:
    """A judgement, the posterior of all inputs, and band powers (k,) of a run of `duration` s that checks the first."""

    found: Judgement
    posterior: InputsPosterior
    checked: Array
    duration: float

    def loads(self) -> dict[str, LoadLevel]:
        """Level of each group of loads."""
        values, ends = self.found.chosen.factors()
        learnt = self.found.chosen.best.learnt
        return {
            group: LoadLevel(value=float(value), interval=(float(low), float(high)), learnt=float(share))
            for group, value, (low, high), share in zip(LOAD_GROUPS, values, ends, learnt, strict=True)
        }

    def sensors(self) -> dict[str, SensorState]:
        """State of each channel."""
        found, seen = self.found, self.found.observed
        chosen = found.chosen.hypothesis if found.verdict == "sensor" else None
        of: dict[str, dict[str, Finding]] = {}
        likely: dict[str, float] = {}
        for one, probability in zip(found.findings, found.probabilities, strict=True):
            if VERDICT_OF[one.hypothesis.kind] == "sensor":
                of.setdefault(one.hypothesis.name, {})[one.hypothesis.kind] = one
                likely[one.hypothesis.name] = likely.get(one.hypothesis.name, 0.0) + float(probability)
        states = {}
        for place, channel in enumerate(seen.channels):
            if channel in states or math.isnan(seen.floor[place]):  # an axis that was not measured has no sensor
                continue
            gain = of.get(channel, {}).get("gain")
            low, middle, high = (None, None, None) if gain is None else map(gain_at, gain.quantiles)
            fault = found.fault if chosen and chosen.name == channel else None
            states[channel] = SensorState(
                gain=0.0 if fault == "dead" else middle,
                gain_interval=None if low is None or high is None or fault == "dead" else (low, high),
                noise=math.sqrt(seen.floor[place]),
                probability=likely.get(channel, 0.0),
                fault=fault,
            )
        return states

    def causes(self) -> tuple[InputCause | NoChange, ...]:
        """Return inputs and that nothing has changed, the most probable first."""
        places = [place for place, one in enumerate(self.found.findings) if one.hypothesis.kind in ("nothing", "input")]
        places.sort(key=lambda place: -self.found.weights[place])
        return tuple(
            self._cause(self.found.findings[place], float(self.found.probabilities[place])) for place in places
        )

    def _cause(self, found: Finding, probability: float) -> InputCause | NoChange:
        if found.hypothesis.kind == "nothing":
            return NoChange(probability=probability, log_evidence=found.log_evidence)
        item = self.found.curves.inputs[found.hypothesis.name]
        low, value, high = item.distribution.from_unit(found.quantiles).tolist()
        return InputCause(
            **{key: getattr(item, key) for key in ("name", "symbol", "unit", "kind")},
            input=item.code,
            probability=probability,
            log_evidence=found.log_evidence,
            value=value,
            interval=(low, high),
            machine_value=item.initial,
        )

    def observable(self) -> Observable:
        """Return what the recording could show, about the machine as it stands in the rock as it was."""
        found, curves, noise = self.found.nothing.best, self.found.curves, self.found.bands.noise
        slopes = []
        for item in curves.inputs.inputs:
            ends = step_ends(item)
            less, more = (curves.at(item.code, value).expected(found.factors, noise) for value in ends)
            slopes.append(np.log(more / less) / math.log(ends[1] / ends[0]))
        powers = curves.nominal.expected(found.factors, noise)
        loads = 2.0 * np.square(found.factors)[:, None] * curves.nominal.transfer.gain / powers
        seen = Visibility.of(curves.inputs, self.found.prior, np.array(slopes), found.scatter, loads)
        return Observable(false_rate=FALSE_RATE, probability=PROBABILITY, inputs=seen.inputs(), loads=seen.loads())

    def joint(self) -> Joint:
        """Posterior of all inputs at once."""
        inputs = self.found.curves.inputs.inputs
        ends = np.quantile(self.posterior.units, _ENDS, axis=0).T
        return Joint(
            inputs={
                item.code: JointInput(
                    value=float(item.distribution.from_unit(middle)),
                    interval=(float(item.distribution.from_unit(low)), float(item.distribution.from_unit(high))),
                    machine_value=item.initial,
                    learnt=float(1.0 - (high - low) / (_ENDS[2] - _ENDS[0])),
                    lower=item.lower,
                    upper=item.upper,
                    distribution=item.distribution.name,
                )
                for item, (low, middle, high) in zip(inputs, ends, strict=True)
            },
            accepted=self.posterior.accepted,
            effective_samples=self.posterior.effective,
            standardised_misfit=_size(self.posterior.standardised),
        )

    @cached_property
    def _powers(self) -> dict[str, Array]:
        """Band powers (k,) of field, machine as it stands, prediction and check."""
        chosen, noise = self.found.chosen, self.found.bands.noise
        return {
            "field": self.found.bands.powers,
            "model": self.found.curves.nominal.expected(self.found.prior.values, noise),
            "predicted": _middle(chosen).expected(chosen.factors()[0], noise),
            "checked": self.checked,
        }

    def statistics(self) -> tuple[ComparedStatistic, ...]:
        """Band RMS values that carry weight."""
        rows = {name: np.sqrt(values) for name, values in self._powers.items()}
        deviation = 0.5 * np.sqrt(np.diag(self.found.chosen.best.scatter))
        return tuple(
            ComparedStatistic(
                name=one.name,
                **{name: float(values[place]) for name, values in rows.items()},
                deviation=float(deviation[place]),
                r2_cv=math.nan,
            )
            for place, one in enumerate(self.found.curves.nominal.transfer.statistics)
        )

    @property
    def largest_deviation(self) -> float:
        """Of a band power, standard deviations."""
        return float(np.abs(self.found.chosen.best.standardised).max())

    @property
    def misfit(self) -> Misfits:
        """Logarithms of field over the others, amplitudes."""
        logs = {name: 0.5 * np.log(self._powers["field"] / self._powers[name]) for name in Misfits.model_fields}
        return Misfits(**{name: _size(values) for name, values in logs.items()})

    @property
    def standardised_misfit(self) -> Misfits:
        """The same in standard deviations, loads fitted; those of the check hold the chance of its short run too."""
        chosen, found = self.found.chosen, self.found
        length = max(self.duration, found.curves.nominal.segment_s)
        chance = np.diag(_middle(chosen).covariance(chosen.factors()[0], found.bands.noise, length))
        checked = np.log(self._powers["field"] / self.checked) / np.sqrt(np.diag(chosen.best.scatter) + chance)
        return Misfits(
            model=_size(found.nothing.best.standardised),
            predicted=_size(chosen.best.standardised),
            checked=_size(checked),
        )


def _size(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
