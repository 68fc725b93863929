"""A commissioning baseline: the usual error of a machine's test points, from windows that are known to be sound."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tbm_gsa.comparison import DEAD_SHARE, UsualError
from tbm_gsa.errors import InputError
from tbm_gsa.history.entries import Window

LEAST_WINDOWS = 5  # a scatter of fewer means nothing
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


def sound_windows(windows: Sequence[Window]) -> list[Window]:
    """Windows with a known error in which the sensor lived: its RMS is no hundredth of the median of point and axis."""
    known = [window for window in windows if np.isfinite(window.entry.relative_error)]
    levels: dict[tuple[str, str], list[float]] = {}
    for window in known:
        levels.setdefault((window.entry.point, window.entry.axis), []).append(window.entry.field_rms)
    least = {key: DEAD_SHARE * float(np.median(values)) for key, values in levels.items()}
    return [one for one in known if one.entry.field_rms >= least[one.entry.point, one.entry.axis]]


def make_baseline(name: str, windows: Sequence[Window], created_ns: int) -> Baseline:
    """Make a baseline of windows with a known error; those of a dead sensor are left out.

    Raises
    ------
    InputError
        Windows of several machines, or too few at any point and axis.
    """
    known = sound_windows(windows)
    machines = sorted({(window.source.machine, window.source.machine_sha256) for window in known})
    if len(machines) > 1:
        listed = ", ".join(f"{machine} {digest[:8]}" for machine, digest in machines)
        raise InputError(f"baseline {name}: windows of several machines: {listed}; choose by --machine or --source")
    errors: dict[tuple[str, str], list[float]] = {}
    for window in known:
        errors.setdefault((window.entry.point, window.entry.axis), []).append(window.entry.relative_error)
    usual = {
        key: Usual(float(np.mean(values)), float(np.std(values, ddof=1)), len(values))
        for key, values in sorted(errors.items())
        if len(values) >= LEAST_WINDOWS
    }
    if not usual:
        most = max(map(len, errors.values()), default=0)
        raise InputError(
            f"baseline {name}: {most} windows with a known error at a point and axis, allowed: at least {LEAST_WINDOWS}"
        )
    entries = [window.entry for window in known]
    since, until = min(one.start_ns for one in entries), max(one.start_ns + one.length_ns for one in entries)
    return Baseline(name, *machines[0], created_ns, since, until, usual)
