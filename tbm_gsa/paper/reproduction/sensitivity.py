"""Figures 11 to 15: which parameters matter, by how much, and what the response does along them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import scipy.stats

from tbm_gsa.paper.published import (
    CURVES_OF,
    DISPLACEMENTS,
    FIGURE_OF,
    LOADS,
    MAIN,
    SHARES,
    STIFFNESSES,
    TRENDS,
)
from tbm_gsa.paper.reproduction import verdict
from tbm_gsa.paper.reproduction.readings import Reading
from tbm_gsa.paper.reproduction.result import Row
from tbm_gsa.paper.reproduction.studies import Study
from tbm_gsa.sensitivity.results import NOT_DETERMINED
from tbm_gsa.sensitivity.sobol.monte_carlo import SAMPLE_SIZES
from tbm_gsa.sensitivity.study.curves import Curve
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS

HARDLY: Final = 0.01
"""A share of the variance, or of the output's spread along an input: below it the note says so."""
_DIRECTIONS: Final = {1: "rises", -1: "falls"}


def spearman(curve: Curve) -> float:
    """Spearman's ρ of a response over its input; 0 of one that does not move."""
    if np.ptp(curve.response) == 0.0:
        return 0.0
    return float(scipy.stats.spearmanr(curve.values, curve.response).statistic)


def sensitivity_rows(study: Study) -> Iterator[Row]:
    """Rows of Figures 11 to 15; what rests on a surrogate that does not follow its output is no finding."""
    for name, figure in FIGURE_OF.items():
        yield from _if_determined(study, [name], _index_rows(study, name, f"figure{figure}.{name}"))
    if study.sampling_gap is not None:
        what = "first indices by sampling, largest distance from those reported"
        paper = f"converged at {SAMPLE_SIZES[-1]:,}".replace(",", " ")
        note = "read as Saltelli's base size; no tolerance given"
        yield study.reading.row("figure11.convergence", what, paper, study.sampling_gap, "no number", note)
    for (name, code), curve in study.curves.items():
        spread = float(np.std(study.outputs[name].best.model.samples.y))
        yield from _if_determined(study, [name], [_trend(study.reading, name, code, curve, spread)])
    amplitudes = _amplitudes(study.reading, study.curves["MF_M", "x2"], study.curves["MF_Se", "x2"])
    yield from _if_determined(study, ["MF_M", "MF_Se"], [amplitudes])


def _index_rows(study: Study, name: str, stem: str) -> Iterator[Row]:
    """Rows of the indices of an output."""
    reading, indices, codes = study.reading, study.outputs[name].indices, PAPER_INPUTS.codes
    first, total = (dict(zip(codes, found.tolist(), strict=True)) for found in (indices.first, indices.total))
    if name in MAIN:
        yield _main(reading, stem, name, first)
    if name in DISPLACEMENTS:
        yield _groups(reading, stem, name, first)
    for code, share in ((code, share) for (of, code), share in SHARES.items() if of == name):
        what, judged = f"share of {code} in {name}, first index", verdict.share(share, first[code])
        note = "the paper: only sensitive to it" if share == 1.0 else "the paper: about"
        yield reading.row(f"{stem}.{code}", what, share, first[code], judged, note)
    yield from _interactions(reading, stem, name, first, total)


def _if_determined(study: Study, names: Sequence[str], rows: Iterable[Row]) -> Iterator[Row]:
    """Rows that rest on the surrogates of some outputs; without their numbers where one does not follow its output."""
    poor = [name for name in names if not study.outputs[name].determined]
    reason = ", ".join(f"R² of {name} {study.outputs[name].best.r2_cv:.2f}" for name in poor)
    for row in rows:
        yield replace(row, ours=NOT_DETERMINED, verdict="no number", note=reason) if poor else row


def _main(reading: Reading, stem: str, name: str, first: Mapping[str, float]) -> Row:
    """Whether the main parameters are the paper's."""
    ranked, paper = sorted(first, key=lambda code: -first[code]), MAIN[name]
    ours = ranked[: verdict.MAIN_COUNT]
    shown = ", ".join(f"{code} {first[code]:.2f}" for code in ours)
    shared = [code for code in paper if code in ours]
    others = ", ".join(f"{code} {first[code]:.3f}" for code in paper if code not in shared)
    note = f"shared: {', '.join(shared) or 'none'}" + (f"; the paper's others here: {others}" if others else "")
    weak = [code for code in shared if first[code] < HARDLY]
    note += f"; hardly any share: {', '.join(weak)}" if weak else ""
    judged = verdict.main_parameters(paper, ranked)
    return reading.row(f"{stem}.main", f"main parameters of {name}", ", ".join(paper), shown, judged, note)


def _groups(reading: Reading, stem: str, name: str, first: Mapping[str, float]) -> Row:
    """Whether loads and connecting stiffnesses are the main parameters of a displacement."""
    loads, stiff = (sum(first[code] for code in codes) for codes in (LOADS, STIFFNESSES))
    judged, ours = verdict.above(0.5, loads + stiff), f"{loads:.2f} + {stiff:.2f}"
    note = "agrees where both together explain more than half of the variance"
    what = f"share of loads (x1–x3) and connecting stiffnesses (x16–x25) in {name}"
    return reading.row(f"{stem}.groups", what, "the main parameters", ours, judged, note)


def _interactions(
    reading: Reading, stem: str, name: str, first: Mapping[str, float], total: Mapping[str, float]
) -> Iterator[Row]:
    """Whether the inputs act one by one."""
    summed, (low, high) = sum(first.values()), verdict.FIRST_SUM
    note, judged = f"agrees from {low:g} to {high:g}", verdict.first_sum(summed)
    yield reading.row(f"{stem}.sum", f"sum of the first indices of {name}", 1.0, summed, judged, note)
    farthest = max(first, key=lambda code: abs(total[code] - first[code]))
    gap, what = total[farthest] - first[farthest], f"largest distance of total and first index in {name}"
    yield reading.row(f"{stem}.total", what, 0.0, gap, verdict.share(0.0, gap), f"of {farthest}")


def _trend(reading: Reading, name: str, code: str, curve: Curve, spread: float) -> Row:
    """Response along an input."""
    paper, rho = TRENDS[name].get(code), spearman(curve)
    change = float(curve.response[-1] - curve.response[0])
    part = float(np.ptp(curve.response)) / spread if spread else 0.0
    ours = f"{'rises' if rho > 0.0 else 'falls' if rho < 0.0 else 'still'}, ρ = {rho:.2f}"
    note = f"{change / float(curve.response[0]):+.1%} over the range"
    if part < HARDLY:
        note += f"; hardly a trend: {part:.2%} of the output's spread"
    stem, what = f"figure{CURVES_OF[name]}.{name}.{code}", f"{name} along {code}"
    if paper is None:
        return reading.row(stem, what, "shown, nothing said", ours, "no number", note)
    return reading.row(stem, what, _DIRECTIONS[paper], ours, verdict.trend(paper, rho), note)


def _amplitudes(reading: Reading, largest: Curve, deviation: Curve) -> Row:
    """Whether the deviation factor moves less with the torque than the largest mesh force."""
    ours = float(np.ptp(largest.response)), float(np.ptp(deviation.response))
    text = f"{ours[1] / 1e3:.3g} against {ours[0] / 1e3:.3g} kN"
    judged = verdict.statement(ours[1] < ours[0])
    return reading.row("figure15.amplitudes", "MF_Se moves less along x2 than MF_M", "smaller", text, judged)
