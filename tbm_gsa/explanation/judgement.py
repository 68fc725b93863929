"""Rock, machine, sensor or not explained: what a recording says of all hypotheses together."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final, get_args

import numpy as np

from tbm_dynamics.loads.description import LoadFactors
from tbm_gsa.explanation.cause_curves import CauseCurves
from tbm_gsa.explanation.evidence import Finding, find
from tbm_gsa.explanation.hypotheses import LEAST_MOVE, VERDICT_OF, VERDICTS, hypotheses, influence
from tbm_gsa.explanation.load_posterior import BandObservation, LoadPosterior, load_posterior
from tbm_gsa.explanation.observed import Observed
from tbm_gsa.explanation.result import Fault, Verdict
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.progress import CountDone

LARGEST_DEVIATION: Final = 3.3
"""Standard deviations that one band power may be off by where something is explained."""
LEAST_SURPRISE: Final = 1e-3
"""Probability of the misfit of all of them."""
LEAST_MODEL_ERROR: Final = 0.02
"""Of a band power: what runs of the model differ from their prediction by. More would hide what is not explained."""
LEAST_BAYES_FACTOR: Final = 3.0
"""Of an input or a sensor against nothing."""


@dataclass(frozen=True, eq=False)
class Judgement:
    """What is found of a recording; k statistics are used.

    Attributes
    ----------
    observed : Observed
    used : ndarray of int, shape (k,)
    bands : BandObservation
    curves : CauseCurves
        Both of these.
    prior : LoadFactors
    findings : tuple of Finding
        Nothing first.
    blind : tuple of str
        Inputs of which this recording cannot tell anything.
    """

    observed: Observed
    used: Integers
    bands: BandObservation
    curves: CauseCurves
    prior: LoadFactors
    findings: tuple[Finding, ...]
    blind: tuple[str, ...]

    @cached_property
    def weights(self) -> Array:
        """Logarithms; the four words are as likely beforehand, and what stands for one word is."""
        words = [VERDICT_OF[one.hypothesis.kind] for one in self.findings]
        logs = np.array([one.log_evidence for one in self.findings])
        return np.asarray(logs - np.log([words.count(word) for word in words]))

    @cached_property
    def probabilities(self) -> Array:
        """Of the findings."""
        shares = np.exp(self.weights - self.weights.max())
        return np.asarray(shares / shares.sum())

    @property
    def nothing(self) -> Finding:
        """That the machine and the sensors are as they were."""
        return self.findings[0]

    @cached_property
    def words(self) -> dict[Verdict, float]:
        """Probability of each verdict."""
        words = np.array([VERDICT_OF[one.hypothesis.kind] for one in self.findings])
        return {word: float(self.probabilities[words == word].sum()) for word in VERDICTS}

    @cached_property
    def leading(self) -> Finding:
        """Most probable finding of the most probable word that names something."""
        named: list[Verdict] = ["rock", "machine", "sensor"]
        word = max(named, key=self.words.__getitem__)
        ranked = sorted(zip(self.weights, self.findings, strict=True), key=lambda pair: -pair[0])
        return next(one for _, one in ranked if VERDICT_OF[one.hypothesis.kind] == word)

    @cached_property
    def verdict(self) -> Verdict:
        """The word."""
        word = max(VERDICTS, key=self.words.__getitem__)
        if word == "not explained":
            return word
        if self.leading is not self.nothing:
            gained = self.leading.log_evidence - self.nothing.log_evidence
            if gained < math.log(LEAST_BAYES_FACTOR):
                return "rock" if fits(self.nothing.best) else "not explained"
        return word if fits(self.leading.best) else "not explained"

    @property
    def probability(self) -> float:
        """Of what was chosen."""
        return float(self.probabilities[self.findings.index(self.chosen)])

    @property
    def fault(self) -> Fault | None:
        """What is wrong with the sensor that the verdict names."""
        return next((fault for fault in get_args(Fault) if fault == self.chosen.hypothesis.kind), None)

    @property
    def chosen(self) -> Finding:
        """Finding that the verdict stands for; where nothing is explained the one that comes nearest."""
        return self.nothing if self.verdict == "rock" else self.leading


def fits(found: LoadPosterior) -> bool:
    """Whether what is left is what chance leaves."""
    return bool(np.abs(found.standardised).max() <= LARGEST_DEVIATION and found.surprise >= LEAST_SURPRISE)


def judge(
    observed: Observed,
    curves: CauseCurves,
    prior: LoadFactors,
    model_error: float = LEAST_MODEL_ERROR,
    progress: CountDone = lambda *_: None,
) -> Judgement:
    """Judge a recording.

    Parameters
    ----------
    observed : Observed
    curves : CauseCurves
        Of the machine at the operating point, and the same reading.
    prior : LoadFactors
    model_error : float
        Standard deviation of a band power's logarithm that the model is wrong by in any case.
    progress : callable, optional

    Raises
    ------
    StudyError
        Too few band powers that say anything.
    """
    used = observed.used(curves.nominal, prior)
    bands = observed.bands.only(used)
    told = curves.only(used)
    still = load_posterior(bands, told.nominal, prior, model_error, np.arange(len(used)))
    codes = [code for code in told.tables if influence(told, code, still, bands.noise) >= LEAST_MOVE]
    channels = [observed.channels[place] for place in used]
    excess = observed.floor[used] / bands.noise
    family, findings = hypotheses(told, codes, channels, excess, model_error), []
    best = -math.inf
    for number, one in enumerate(family):
        findings.append(find(one, bands, prior, best))
        best = max(best, findings[-1].best.log_evidence)
        progress(number + 1, len(family))
    return Judgement(
        observed, used, bands, told, prior, tuple(findings), tuple(code for code in told.tables if code not in codes)
    )
