"""Figures 11 to 15: which parameters matter, by how much, and what the response does along them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.stats

from tbm_gsa.paper.reproduction import verdict
from tbm_gsa.paper.reproduction.readings import Reading
from tbm_gsa.paper.reproduction.row import Row, Value
from tbm_gsa.paper.reproduction.studies import Study
from tbm_gsa.paper.reproduction.verdict import Verdict
from tbm_gsa.paper.sensitivity import (
    CURVES_OF,
    DISPLACEMENTS,
    FIGURE_OF,
    LOADS,
    MAIN,
    SHARES,
    SHOWN_WITHOUT_STATEMENT,
    STIFFNESSES,
    TRENDS,
)
from tbm_gsa.sensitivity.sobol.monte_carlo import SAMPLE_SIZES
from tbm_gsa.sensitivity.study.curves import Curve, response_curve
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, InputSet

HARDLY: Final = 0.01
"""A share of the variance, or of the output's spread along an input: below it the note says so."""
_DIRECTIONS: Final = {1: "rises", -1: "falls"}


@dataclass(frozen=True, eq=False)
class SensitivityEvidence:
    """A study under one reading, with the response along every input that the paper shows.

    Attributes
    ----------
    reading : Reading
    study : StudyResult
    curves : mapping of (str, str) to Curve
        By output and input, in the paper's order.
    """

    reading: Reading
    study: Study
    curves: Mapping[tuple[str, str], Curve]


def gather_sensitivity(reading: Reading, study: Study, inputs: InputSet = PAPER_INPUTS) -> SensitivityEvidence:
    """Compute the curves of Figures 12 and 15."""
    pairs = [(name, code) for name, codes in TRENDS.items() for code in codes] + list(SHOWN_WITHOUT_STATEMENT)
    curves = {
        (name, code): response_curve(study.outputs[name].best.model, inputs, inputs.codes.index(code))
        for name, code in pairs
    }
    return SensitivityEvidence(reading, study, curves)


def spearman(curve: Curve) -> float:
    """Spearman's ρ of a response over its input; 0 of one that does not move."""
    if np.ptp(curve.response) == 0.0:
        return 0.0
    return float(scipy.stats.spearmanr(curve.values, curve.response).statistic)


def sensitivity_rows(evidence: SensitivityEvidence, inputs: InputSet = PAPER_INPUTS) -> Iterator[Row]:
    """Rows of Figures 11 to 15."""
    rows = _Rows(evidence.reading)
    analyses = evidence.study.outputs
    for name, figure in FIGURE_OF.items():
        first = dict(zip(inputs.codes, analyses[name].indices.first.tolist(), strict=True))
        total = dict(zip(inputs.codes, analyses[name].indices.total.tolist(), strict=True))
        if name in MAIN:
            yield rows.main(name, figure, first)
        if name in DISPLACEMENTS:
            yield rows.groups(name, figure, first)
        yield from (rows.share(name, figure, code, first[code]) for of, code in SHARES if of == name)
        yield from rows.interactions(name, figure, first, total)
    if evidence.study.sampling_gap is not None:
        yield rows.convergence(evidence.study.sampling_gap)
    for (name, code), curve in evidence.curves.items():
        yield rows.trend(name, code, curve, float(np.std(analyses[name].best.model.samples.y)))
    yield rows.amplitudes(evidence.curves["MF_M", "x2"], evidence.curves["MF_Se", "x2"])


class _Rows:
    """Rows under one reading."""

    def __init__(self, reading: Reading) -> None:
        self._reading = reading

    def _row(
        self, stem: str, source: str, what: str, paper: Value, ours: Value, judged: Verdict, note: str = ""
    ) -> Row:
        return Row(self._reading.id(stem), source, what, paper, ours, judged, note, reading=self._reading.name)

    def main(self, name: str, figure: str, first: Mapping[str, float]) -> Row:
        """Judge the main parameters."""
        ranked = sorted(first, key=lambda code: -first[code])
        paper = MAIN[name]
        shown = ", ".join(f"{code} {first[code]:.2f}" for code in ranked[: verdict.MAIN_COUNT])
        shared = [code for code in paper if code in ranked[: verdict.MAIN_COUNT]]
        others = ", ".join(f"{code} {first[code]:.3f}" for code in paper if code not in shared)
        note = f"shared: {', '.join(shared) or 'none'}" + (f"; the paper's others here: {others}" if others else "")
        weak = [code for code in shared if first[code] < HARDLY]
        note += f"; hardly any share: {', '.join(weak)}" if weak else ""
        judged = verdict.main_parameters(paper, ranked)
        stem = f"{_key(figure)}.{name}.main"
        return self._row(stem, figure, f"main parameters of {name}", ", ".join(paper), shown, judged, note)

    def groups(self, name: str, figure: str, first: Mapping[str, float]) -> Row:
        """Judge that loads and connecting stiffnesses are the main parameters of a displacement."""
        loads, stiff = (sum(first[code] for code in codes) for codes in (LOADS, STIFFNESSES))
        judged = verdict.above(0.5, loads + stiff)
        note = "agrees where both together explain more than half of the variance"
        what = f"share of loads (x1–x3) and connecting stiffnesses (x16–x25) in {name}"
        ours = f"{loads:.2f} + {stiff:.2f}"
        return self._row(f"{_key(figure)}.{name}.groups", figure, what, "the main parameters", ours, judged, note)

    def share(self, name: str, figure: str, code: str, ours: float) -> Row:
        """Judge the share of a parameter."""
        paper = SHARES[name, code]
        what = f"share of {code} in {name}, first index"
        note = "the paper: only sensitive to it" if paper == 1.0 else "the paper: about"
        judged = verdict.share(paper, ours)
        return self._row(f"{_key(figure)}.{name}.{code}", figure, what, paper, ours, judged, note)

    def interactions(
        self, name: str, figure: str, first: Mapping[str, float], total: Mapping[str, float]
    ) -> Iterator[Row]:
        """Judge that the inputs act one by one."""
        summed, stem = sum(first.values()), f"{_key(figure)}.{name}"
        low, high = verdict.FIRST_SUM
        note = f"agrees from {low:g} to {high:g}"
        judged = verdict.first_sum(summed)
        yield self._row(f"{stem}.sum", figure, f"sum of the first indices of {name}", 1.0, summed, judged, note)
        farthest = max(first, key=lambda code: abs(total[code] - first[code]))
        gap = total[farthest] - first[farthest]
        what = f"largest distance of total and first index in {name}"
        note = f"of {farthest}"
        yield self._row(f"{stem}.total", figure, what, 0.0, gap, verdict.share(0.0, gap), note)

    def convergence(self, gap: float) -> Row:
        """Show how far the largest sample is from the indices reported."""
        what = "first indices by sampling, largest distance from those reported"
        paper, note = (
            f"converged at {SAMPLE_SIZES[-1]:,}".replace(",", " "),
            "read as Saltelli's base size; no tolerance given",
        )
        return self._row("figure11.convergence", "Figure 11", what, paper, gap, "no number", note)

    def trend(self, name: str, code: str, curve: Curve, spread: float) -> Row:
        """Judge the response along an input."""
        paper, rho = TRENDS[name].get(code), spearman(curve)
        change = float(curve.response[-1] - curve.response[0])
        part = float(np.ptp(curve.response)) / spread if spread else 0.0
        ours = f"{'rises' if rho > 0.0 else 'falls' if rho < 0.0 else 'still'}, ρ = {rho:.2f}"
        note = f"{change / float(curve.response[0]):+.1%} over the range"
        if part < HARDLY:
            note += f"; hardly a trend: {part:.2%} of the output's spread"
        figure = CURVES_OF[name]
        stem, what = f"{_key(figure)}.{name}.{code}", f"{name} along {code}"
        if paper is None:
            return self._row(stem, figure, what, "shown, nothing said", ours, "no number", note)
        return self._row(stem, figure, what, _DIRECTIONS[paper], ours, verdict.trend(paper, rho), note)

    def amplitudes(self, largest: Curve, deviation: Curve) -> Row:
        """Judge that the deviation factor moves less with the torque than the largest mesh force."""
        ours = float(np.ptp(largest.response)), float(np.ptp(deviation.response))
        what = "MF_Se moves less along x2 than MF_M"
        text = f"{ours[1] / 1e3:.3g} against {ours[0] / 1e3:.3g} kN"
        judged = verdict.statement(ours[1] < ours[0])
        return self._row("figure15.amplitudes", "Figure 15", what, "smaller", text, judged)


def _key(figure: str) -> str:
    return figure.lower().replace(" ", "")
