"""Simulations of a campaign that failed: how many, where in the ranges of the inputs, why; and how many may.

What failed is missing from the design: surrogates are fitted to the rest, and indices speak of ranges part of which
nothing supports. Where failures lie is found input by input: they concentrate on a side of it where the ranks of its
values among all simulations that ended differ from chance with a probability below `CHANCE` (Mann and Whitney's test,
two-sided, multiplied by the number of inputs: Bonferroni). The side is told by the halves of the input's range.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal, Self

import numpy as np
import scipy  # its parts load on first use
from numpy.typing import NDArray

from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_gsa.sensitivity.study.store import Store
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.texts import LONGEST_NAME, shortened

WARNED: Final = 0.05
REFUSED: Final = 0.20
"""Share of failed simulations above which a study is refused unless it is asked for."""
CHANCE: Final = 0.01
_NUMBERS: Final = re.compile(r"[-+.\d]+(e[-+]?\d+)?")
_NAMED: Final = 3

Half = Literal["lower", "upper"]


@dataclass(frozen=True)
class FailureRegion:
    """Half of an input's range in which failures concentrate.

    Attributes
    ----------
    input : str
    half : {"lower", "upper"}
        Side of the median of the input's distribution.
    failed, simulations : int
        In this half.
    low, high : float
        Least and greatest value of the input at which simulations of this half failed, in its unit.
    probability : float
        That chance alone concentrates them so on a side of any input.
    """

    input: str
    half: Half
    failed: int
    simulations: int
    low: float
    high: float
    probability: float


@dataclass(frozen=True)
class Failures:
    """Failed simulations of a campaign.

    Attributes
    ----------
    failed, simulations : int
        Of the simulations that ended, training and test.
    share : float
        The first by the second.
    reason : str
        The commonest one; reasons that differ in their numbers only are one.
    of_reason : int
        Simulations with it.
    regions : tuple of FailureRegion
        The least probable first; empty where failures lie as chance puts them.
    """

    failed: int
    simulations: int
    share: float
    reason: str
    of_reason: int
    regions: tuple[FailureRegion, ...]

    @classmethod
    def of(cls, store: Store) -> Self | None:
        """Failures of a store; None without one."""
        reasons = [reason for _, reason in store.failures()]
        if not reasons:
            return None
        points, failed = store.ended()
        kinds = Counter(_kind(reason) for reason in reasons)
        ((kind, count),) = kinds.most_common(1)
        commonest = next(reason for reason in reasons if _kind(reason) == kind)
        return cls(
            failed=len(reasons),
            simulations=len(points),
            share=len(reasons) / len(points),
            reason=shortened(commonest, LONGEST_NAME),
            of_reason=count,
            regions=tuple(sorted(_regions(store.problem.inputs, points, failed), key=lambda one: one.probability)),
        )

    @property
    def warned(self) -> bool:
        """Whether they are so many that what is left is in doubt."""
        return self.share > WARNED

    def text(self) -> str:
        """One sentence: how many, where and why."""
        parts = [f"{self.failed} of {self.simulations} simulations failed ({self.share:.0%})"]
        if self.failed < self.simulations:
            parts.append(
                "; ".join(map(_region_text, self.regions[:_NAMED])) or "no half of an input's range stands out"
            )
        parts.append(f"commonest reason ({self.of_reason} of {self.failed}): {self.reason}")
        return "; ".join(parts)


def checked_failures(store: Store, allowed: bool = False, remedy: str = "") -> Failures | None:
    """Failures of a campaign that has run; None without one.

    Parameters
    ----------
    store : Store
    allowed : bool
        Whether any number but all may fail.
    remedy : str
        How that is asked for, if it can be.

    Raises
    ------
    StudyError
        All failed, or more than `REFUSED` of them and that is not allowed.
    """
    failures = Failures.of(store)
    if failures is None:
        return None
    if failures.failed == failures.simulations:
        reason = f"commonest reason ({failures.of_reason} of {failures.failed}): {failures.reason}"
        raise StudyError(
            f"{store.path}: all {failures.failed} simulations failed; {reason}; allowed: some that end well"
        )
    if failures.share > REFUSED and not allowed:
        raise StudyError(f"{store.path}: {failures.text()}; allowed: up to {REFUSED:.0%}{remedy}")
    return failures


def _kind(reason: str) -> str:
    """Reason without its numbers, which differ from sample to sample."""
    return _NUMBERS.sub("#", reason)


def _regions(inputs: InputSet, points: Array, failed: NDArray[np.bool_]) -> Iterator[FailureRegion]:
    """Sides on which failures concentrate: points (n, d) in the units of the inputs, failed (n,)."""
    if failed.all():
        return
    for item, values, place in zip(inputs.inputs, points.T, inputs.to_unit(points).T, strict=True):
        test = scipy.stats.mannwhitneyu(place[failed], place[~failed])
        probability = min(1.0, len(inputs) * float(test.pvalue))
        if probability < CHANCE:
            upper = bool(np.median(place[failed]) >= 0.5)
            inside = place >= 0.5 if upper else place < 0.5
            there = values[inside & failed]
            yield FailureRegion(
                item.code,
                "upper" if upper else "lower",
                len(there),
                int(np.count_nonzero(inside)),
                float(there.min()),
                float(there.max()),
                probability,
            )


def _region_text(region: FailureRegion) -> str:
    return (
        f"{region.failed} of them in the {region.half} half of {region.input}, where {region.failed} of "
        f"{region.simulations} failed (from {region.low:.4g} to {region.high:.4g})"
    )
