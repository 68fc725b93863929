"""A commissioning baseline: the usual level of a machine's test points, from windows that are known to be sound."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, cast

import numpy as np

from tbm_gsa.comparison import UsualRatio
from tbm_gsa.history.entries import SourceKind, WindowGroup
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

LEAST_WINDOWS: Final = 5  # a scatter of fewer means nothing
BY_ORIGIN: Final = ("point", "axis", "machine", "machine_sha256", "kind")
_COLUMNS = {"x": (0,), "y": (1,), "z": (2,), "yz": (1, 2)}


@dataclass(frozen=True)
class ErrorStatistics:
    """Level of one point and axis over so many windows.

    Attributes
    ----------
    mean, scatter : float
        Mean and standard deviation of the relative error.
    windows : int
    log_mean, log_scatter : float, optional
        Those of the logarithm of measured over computed RMS; None where a file of an older version does not say.
    """

    mean: float
    scatter: float
    windows: int
    log_mean: float | None = None
    log_scatter: float | None = None

    @classmethod
    def of(cls, errors: Array, logs: Array) -> ErrorStatistics:
        """Statistics of the relative errors and logarithms (n,) of windows."""
        moments = [function(values) for values in (errors, logs) for function in (np.mean, _deviation)]
        mean, scatter, log_mean, log_scatter = map(float, moments)
        return cls(mean, scatter, len(errors), log_mean, log_scatter)


@dataclass(frozen=True)
class Baseline:
    """Usual errors of a machine.

    Attributes
    ----------
    name : str
    machine, machine_sha256 : str
    created_ns : int
    since_ns, until_ns : int
        From the begin of the first window to the end of the last one.
    usual : mapping of (point, axis) to ErrorStatistics
    kind : {"live", "replay", "offline", "synthetic"}
        Of the windows; None where a file of an older version does not say.
    """

    name: str
    machine: str
    machine_sha256: str
    created_ns: int
    since_ns: int
    until_ns: int
    usual: Mapping[tuple[str, str], ErrorStatistics]
    kind: SourceKind | None = None

    def usual_ratios(self) -> dict[str, UsualRatio]:
        """Return what is usual by point, as an `AlarmRule` has it."""
        found: dict[str, UsualRatio] = {}
        for (point, axis), usual in self.usual.items():
            if usual.log_mean is None or usual.log_scatter is None:
                continue
            known = found.setdefault(point, UsualRatio(np.full(3, np.nan), np.full(3, np.nan)))
            for column in _COLUMNS[axis]:
                np.asarray(known.mean)[column], np.asarray(known.scatter)[column] = usual.log_mean, usual.log_scatter
        return found


def _deviation(values: Array) -> float:
    return float(np.std(values, ddof=1))


def make_baseline(name: str, groups: Iterable[WindowGroup], created_ns: int) -> Baseline:
    """Average windows with a known error into a baseline; those of a dead sensor are left out.

    Parameters
    ----------
    name : str
    groups : iterable of WindowGroup
        By `BY_ORIGIN`, as `Queries.groups` returns them; one at a time is held.
    created_ns : int

    Raises
    ------
    InputError
        Windows of several machines or kinds, too few at any point and axis, or no name.
    """
    if not (name.strip() and name.isprintable()):
        raise InputError(f"baseline {name!r}: allowed: a name of printable characters")
    usual: dict[tuple[str, str], ErrorStatistics] = {}
    origins: set[tuple[str, ...]] = set()
    spans: list[tuple[int, int]] = []
    most = 0
    for group in groups:
        sound = group.sound()
        if not sound.any():
            continue
        point, axis, *origin = group.key
        origins.add(tuple(origin))
        starts, errors = group.start_ns[sound], group.relative_error[sound]
        spans.append((int(starts[0]), int((starts + group.length_ns[sound]).max())))
        most = max(most, len(errors))
        if len(errors) >= LEAST_WINDOWS:
            usual[point, axis] = ErrorStatistics.of(errors, group.log_ratio[sound])
    _refuse_mixture(name, origins)
    if not usual:
        raise InputError(
            f"baseline {name}: {most} windows with a known error at a point and axis, allowed: at least {LEAST_WINDOWS}"
        )
    since, until = min(start for start, _ in spans), max(end for _, end in spans)
    machine, digest, kind = origins.pop()
    return Baseline(name, machine, digest, created_ns, since, until, usual, cast(SourceKind, kind))


def _refuse_mixture(name: str, origins: Iterable[tuple[str, ...]]) -> None:
    """Refuse windows that have no usual error in common."""
    machines = sorted({f"{machine} {digest[:8]}" for machine, digest, _ in origins})
    if len(machines) > 1:
        raise InputError(
            f"baseline {name}: windows of several machines: {', '.join(machines)}; choose by --machine, "
            "a name or those digits"
        )
    kinds = sorted({kind for *_, kind in origins})
    if len(kinds) > 1:
        raise InputError(f"baseline {name}: windows of several kinds: {', '.join(kinds)}; choose by --source")
