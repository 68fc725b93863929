"""Windows of a long time as trends: of each part of it all, or enough of them, spread evenly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any, Final, Self

import numpy as np

from tbm_gsa.history.context import ContextKey
from tbm_gsa.history.entries import WindowGroup, WindowSource
from tbm_gsa.history.queries import Queries, Selection
from tbm_msgs_py.base.arrays import Array

PARTS: Final = 300
"""Of the time, each a median with its 5 and 95 % in a figure: more than a third of a page has pixels."""
MOST_OF_PART: Final = 1200
"""Windows of a part that are all read; of more, those of `MOMENTS`."""
MOMENTS: Final = 40
_NUMBERS: Final = [
    ("start_ns", "i8"),
    ("length_ns", "i8"),
    ("field_rms", "f8"),
    ("model_rms", "f8"),
    ("relative_error", "f8"),
    ("field_peak", "f8"),
    ("field_kurtosis", "f8"),
]


@dataclass(frozen=True, eq=False)
class TrendGroup(WindowGroup):
    """Windows of one point, axis, machine and kind of source, the key, and of one context if that was asked for.

    Attributes
    ----------
    field_peak, field_kurtosis : array, (n,)
        m/s²; not finite where it is not known.
    """

    field_peak: Array
    field_kurtosis: Array

    @property
    def field_crest_factor(self) -> Array:
        """Peak over RMS, (n,); not finite where it is not known."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.field_peak / self.field_rms)

    @classmethod
    def joined(cls, groups: Sequence[Self]) -> Self:
        """One group of several, in the order of time."""
        columns = {
            one.name: np.concatenate([getattr(group, one.name) for group in groups])
            for one in fields(cls)
            if one.name != "key"
        }
        order = np.argsort(columns["start_ns"], kind="stable")
        return cls(groups[0].key, **{name: values[order] for name, values in columns.items()})

    @property
    def middle_ns(self) -> Array:
        """Middles of the windows, ns, (n,)."""
        return np.asarray(self.start_ns + self.length_ns // 2, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Spread:
    """Trends of a selection.

    Attributes
    ----------
    first_ns, last_ns : int
        Begins of the first and last window.
    groups : tuple of TrendGroup
    sources : tuple of WindowSource
        That the windows are of.
    count : int
        Windows that were read.
    thinned : int
        Parts of the time of which not all were read.
    """

    first_ns: int
    last_ns: int
    groups: tuple[TrendGroup, ...]
    sources: tuple[WindowSource, ...]
    count: int
    thinned: int

    @property
    def note(self) -> str:
        """What was left out; empty if nothing was."""
        if not self.thinned:
            return ""
        return (
            f"{self.count} windows read: of {self.thinned} of {PARTS} parts of the time, which have more than "
            f"{MOST_OF_PART} windows each, those of {MOMENTS} moments, evenly spread"
        )

    def edges_ns(self) -> Array:
        """Limits of the parts of the time, ns, (`PARTS` + 1,)."""
        return np.linspace(self.first_ns, self.last_ns + 1, PARTS + 1)


def read_spread(history: Queries, selection: Selection, by: ContextKey | None = None) -> Spread | None:
    """Read the trends of a selection in time and memory that hardly grow with its length; None without a window."""
    ends = history.ends(selection)
    if ends is None:
        return None
    sources = history.sources()
    rows: dict[tuple[str, ...], list[tuple[Any, ...]]] = {}
    used: set[int] = set()
    thinned = 0
    for begin_ns, end_ns in _parts(*ends):
        found, whole = history.stretch(begin_ns, end_ns, selection, by, MOST_OF_PART, MOMENTS)
        thinned += not whole
        for number, point, axis, *numbers, group, _ in found:
            source = sources[number]
            used.add(number)
            key = (point, axis, source.machine, source.kind, *([group] if by else ()))
            rows.setdefault(key, []).append(tuple(numbers))
    groups = tuple(_group(key, members) for key, members in sorted(rows.items()))
    count = sum(len(group.start_ns) for group in groups)
    return Spread(*ends, groups, tuple(sources[number] for number in sorted(used)), count, thinned)


def _parts(first_ns: int, last_ns: int) -> Iterator[tuple[int, int]]:
    """Begin and end of parts of equal length that hold all from the first to the last time."""
    length = -(-(last_ns + 1 - first_ns) // PARTS)
    for begin in range(first_ns, last_ns + 1, length):
        yield begin, min(begin + length, last_ns + 1)


def _group(key: tuple[str, ...], rows: list[tuple[Any, ...]]) -> TrendGroup:
    read = np.array(rows, dtype=_NUMBERS)
    return TrendGroup(key, *(read[name] for name, _ in _NUMBERS))
