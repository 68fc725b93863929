"""Parts of a study that were run apart from one another, joined in one store."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from tbm_gsa.reading import Part
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.problem import StudyProblem, difference
from tbm_gsa.sensitivity.study.store import STORE_NAME, EndedRow, Store

SAME: Final = 1e-9
"""Relative difference of an output that processors of different kinds may make."""


class TakenPart(Part):
    """A part that was joined: its folder, simulations that ended there, and how many of them were new here."""

    folder: str
    ended: int
    taken: int


class MergeResult(Part):
    """What `gsa merge --json` prints.

    Attributes
    ----------
    folder : str
    parts : tuple of TakenPart
    total, ok, failed, missing : int
        Simulations of the design, and what became of them.
    """

    folder: str
    parts: tuple[TakenPart, ...]
    total: int
    ok: int
    failed: int
    missing: int


def merge_studies(folders: Sequence[Path], out: Path) -> MergeResult:
    """Join the stores of parts of one study.

    Nothing is taken if one of them does not fit. What is in `out` already stays, so parts may be joined as they come.

    Parameters
    ----------
    folders : sequence of Path
        Of the parts.
    out : Path
        Folder of the whole study, made if it does not exist.

    Raises
    ------
    StudyError
        A folder without a store, parts of different studies, one simulation with two results.
    """
    if not folders:
        raise StudyError("no folder of a part, allowed: at least one")
    for place, folder in enumerate(folders):
        if folder.resolve() in [one.resolve() for one in (out, *folders[:place])]:
            raise StudyError(f"{folder}: given twice, allowed: each part once, and another folder for the whole")
    problem = _problem(folders)
    with Store.create_or_open(out / STORE_NAME, problem) as whole:
        ended = whole.ended_rows()
        taken = []
        for folder in folders:
            with Store.open(folder / STORE_NAME) as store:
                part = store.ended_rows()
            new = _new(part, ended, folder)
            ended |= new
            taken.append(TakenPart(folder=str(folder), ended=len(part), taken=len(new)))
        whole.take(ended)
        counts = whole.counts()
    return MergeResult(
        folder=str(out),
        parts=tuple(taken),
        total=counts.total,
        ok=counts.ok,
        failed=counts.failed,
        missing=counts.total - counts.done,
    )


def _problem(folders: Sequence[Path]) -> StudyProblem:
    """Return what all parts answer."""
    found: list[StudyProblem] = []
    for folder in folders:
        with Store.open(folder / STORE_NAME) as store:
            found.append(store.problem)
        if differs := difference(found[0], found[-1]):
            raise StudyError(f"{folder}: of another study than {folders[0]} (first there, then here: {differs})")
    return found[0]


def _new(part: Mapping[int, EndedRow], before: Mapping[int, EndedRow], folder: Path) -> dict[int, EndedRow]:
    """Return the simulations of a part that were not there before; those that were must say the same.

    One that failed before, as where a worker died, gives way to one that ended well.
    """
    new = {}
    for row, one in part.items():
        here, there = one.outcome.outputs, before[row].outcome.outputs if row in before else None
        if here is not None and there is not None and not _same(here, there):
            raise StudyError(
                f"{folder}: simulation {row} has another result than in a part before it, allowed: one result each"
            )
        if row not in before or (there is None and here is not None):
            new[row] = one
    return new


def _same(outputs: Mapping[str, float], others: Mapping[str, float]) -> bool:
    return all(math.isclose(value, others[name], rel_tol=SAME) for name, value in outputs.items())
