"""A commissioning baseline: the usual error of a machine's test points, from windows that are known to be sound."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from tbm_gsa.comparison import UsualError
from tbm_gsa.errors import InputError
from tbm_gsa.history.entries import Group

LEAST_WINDOWS: Final = 5  # a scatter of fewer means nothing
BY_MACHINE: Final = ("point", "axis", "machine", "machine_sha256")
_COLUMNS = {"x": (0,), "y": (1,), "z": (2,), "yz": (1, 2)}


@dataclass(frozen=True)
class Usual:
    """Error of one point and axis: mean and standard deviation over so many windows."""

    mean: float
    scatter: float
    windows: int


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
    usual : mapping of (point, axis) to Usual
    """

    name: str
    machine: str
    machine_sha256: str
    created_ns: int
    since_ns: int
    until_ns: int
    usual: Mapping[tuple[str, str], Usual]

    def usual_errors(self) -> dict[str, UsualError]:
        """Give what an `AlarmRule` is set against."""
        found: dict[str, UsualError] = {}
        for (point, axis), usual in self.usual.items():
            known = found.setdefault(point, UsualError(np.full(3, np.nan), np.full(3, np.nan)))
            for column in _COLUMNS[axis]:
                np.asarray(known.mean)[column], np.asarray(known.scatter)[column] = usual.mean, usual.scatter
        return found


def make_baseline(name: str, groups: Iterable[Group], created_ns: int) -> Baseline:
    """Make a baseline of windows with a known error; those of a dead sensor are left out.

    Parameters
    ----------
    name : str
    groups : iterable of Group
        By `BY_MACHINE`, as `History.groups` gives them; one at a time is held.
    created_ns : int

    Raises
    ------
    InputError
        Windows of several machines, too few at any point and axis, or no name.
    """
    if not (name.strip() and name.isprintable()):
        raise InputError(f"baseline {name!r}: allowed: a name of printable characters")
    usual: dict[tuple[str, str], Usual] = {}
    machines: set[tuple[str, str]] = set()
    spans: list[tuple[int, int]] = []
    most = 0
    for group in groups:
        sound = group.sound()
        if not sound.any():
            continue
        point, axis, machine, digest = group.key
        machines.add((machine, digest))
        starts, errors = group.start_ns[sound], group.relative_error[sound]
        spans.append((int(starts[0]), int((starts + group.length_ns[sound]).max())))
        most = max(most, len(errors))
        if len(errors) >= LEAST_WINDOWS:
            usual[point, axis] = Usual(float(np.mean(errors)), float(np.std(errors, ddof=1)), len(errors))
    if len(machines) > 1:
        listed = ", ".join(f"{machine} {digest[:8]}" for machine, digest in sorted(machines))
        raise InputError(f"baseline {name}: windows of several machines: {listed}; choose by --machine or --source")
    if not usual:
        raise InputError(
            f"baseline {name}: {most} windows with a known error at a point and axis, allowed: at least {LEAST_WINDOWS}"
        )
    since, until = min(start for start, _ in spans), max(end for _, end in spans)
    return Baseline(name, *machines.pop(), created_ns, since, until, usual)
