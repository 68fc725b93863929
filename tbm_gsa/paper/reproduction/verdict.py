"""When one of our numbers agrees with the paper's: pure rules, each tolerance in one place.

``agrees`` and ``differs`` are findings. ``given`` is our own input handed back, ``calibrated`` a number that was fitted
to the paper's, ``no number`` a thing the paper shows without saying how much.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, Literal, get_args

RowVerdict = Literal["agrees", "differs", "given", "calibrated", "no number"]
VERDICTS: Final[tuple[RowVerdict, ...]] = get_args(RowVerdict)

LEVEL: Final = 0.15
"""RMS and other levels: relative."""
SHARE: Final = 0.15
"""Shares of a variance, and relative errors: absolute."""
R2: Final = 0.005
"""By how much R² may be lower."""
LINE_HZ: Final = 0.5
FIRST_SUM: Final = (0.9, 1.05)
MAIN_SHARED, MAIN_COUNT = 3, 5
"""Of the paper's five main parameters, at least three are among our five."""
_ROUNDING: Final = 1e-9


def level(paper: float, ours: float) -> RowVerdict:
    """Judge a level, both in one unit."""
    return _said(abs(ours - paper) <= LEVEL * abs(paper) + _ROUNDING * abs(paper))


def share(paper: float, ours: float) -> RowVerdict:
    """Judge a share of a whole, 0 to 1."""
    return _said(abs(ours - paper) <= SHARE + _ROUNDING)


def r_squared(paper: float, ours: float) -> RowVerdict:
    """Judge an R²; a higher one agrees."""
    return _said(ours >= paper - R2 - _ROUNDING)


def above(limit: float, ours: float) -> RowVerdict:
    """Judge what the paper says to be greater than a limit."""
    return _said(ours > limit)


def line(paper_hz: float, ours_hz: float | None) -> RowVerdict:
    """Judge a line of a spectrum; None where none stands out."""
    return _said(ours_hz is not None and abs(ours_hz - paper_hz) <= LINE_HZ + _ROUNDING)


def between(limits: tuple[float, float], ours: float | None) -> RowVerdict:
    """Judge what lies inside limits, ends included; None lies nowhere."""
    return _said(ours is not None and limits[0] - _ROUNDING <= ours <= limits[1] + _ROUNDING)


def first_sum(ours: float) -> RowVerdict:
    """Judge a sum of first indices that the paper calls almost one."""
    return between(FIRST_SUM, ours)


def main_parameters(paper: Sequence[str], ranked: Sequence[str]) -> RowVerdict:
    """Judge main parameters: of fewer than three all must be ours, as many as the paper names.

    Parameters
    ----------
    paper : sequence of str
        Codes, in any order.
    ranked : sequence of str
        Our codes, the strongest first.
    """
    count = MAIN_COUNT if len(paper) >= MAIN_SHARED else len(paper)
    return _said(len(set(paper) & set(ranked[:count])) >= min(MAIN_SHARED, len(paper)))


def trend(paper: int, rho: float) -> RowVerdict:
    """Judge a trend by the sign of Spearman's ρ; one that is not defined has none."""
    return _said(rho * paper > 0.0)


def falling(ours: Sequence[float]) -> RowVerdict:
    """Judge what falls from each value to the next."""
    return _said(all(before > after for before, after in pairwise(ours)))


def statement(holds: bool) -> RowVerdict:
    """Judge a statement that holds or does not."""
    return _said(holds)


def fitted(verdict: RowVerdict, was_fitted: bool) -> RowVerdict:
    """Verdict on a fitted value: an agreement is `calibrated`, a fit that missed stays a difference."""
    return "calibrated" if was_fitted and verdict == "agrees" else verdict


def echoed(same: bool) -> RowVerdict:
    """Judge our own input handed back: never an agreement, but a difference if it is not the paper's."""
    return "given" if same else "differs"


def close(paper: float, ours: float) -> bool:
    """Whether two inputs are one number."""
    return math.isclose(paper, ours, rel_tol=_ROUNDING)


def _said(agrees: bool) -> RowVerdict:
    return "agrees" if agrees else "differs"
