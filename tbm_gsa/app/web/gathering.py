"""What was heard of the nodes, gathered into the section of the page that changes by the second."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Final

import numpy as np

from tbm_gsa.app.web.expected import Expectation
from tbm_gsa.app.web.state import (
    DriveShares,
    NodeCondition,
    NodeState,
    Now,
    Operation,
    PointCondition,
    PointState,
    Verdict,
)
from tbm_gsa.app.web.verdict import Situation, judge
from tbm_gsa.comparison.streams import SIDES, Side
from tbm_gsa.history import UNKNOWN, Context, EventKind
from tbm_gsa.history.event_list import ListedEvent
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.drive_state import drive_name
from tbm_msgs_py.base.units import iso_time

LOST_S: Final = 5.0
"""Without a word, after which a node is missing: it says something once a second."""
QUIET_S: Final = 15.0
"""Without a window in which something was measured, after which no sensor is heard."""
_WINDOWS: Final = 10  # that a level is the RMS of
_LOOKS: Final = 5  # over which drives are averaged
_OF_EVENT: Final[Mapping[EventKind, PointCondition]] = {
    "dead": "dead",
    "silent": "silent",
    "refused": "faulty",
    "sensor": "faulty",
}
_TEXTS: Final[dict[PointCondition, str]] = {
    "within": "as expected",
    "above": "above what is expected",
    "below": "below what is expected",
    "dead": "measures next to nothing",
    "silent": "no signal",
    "faulty": "faulty",
    "unknown": "not known",
}


@dataclass
class _Heard:
    """What a node said last, and when: by the computer (ISO 8601), and s of a steady clock."""

    condition: NodeCondition
    text: str
    at: str
    steady: float


@dataclass
class _Levels:
    """Latest windows of one point, RMS along x by side, m/s²; NaN of a window without."""

    latest: dict[Side, deque[float]] = field(default_factory=lambda: {side: deque(maxlen=_WINDOWS) for side in SIDES})
    steady: float = -math.inf
    apart_s: float = 2.0

    def rms(self, side: Side) -> float:
        """Over the latest windows; NaN where the last one has none."""
        values = self.latest[side]
        if not values or math.isnan(values[-1]):
            return math.nan
        known = [value for value in values if not math.isnan(value)]
        return math.sqrt(sum(value * value for value in known) / len(known))


class _Means:
    """Means of rows of numbers over the latest looks."""

    def __init__(self) -> None:
        self._looks: deque[tuple[Array, int]] = deque(maxlen=_LOOKS)
        self._sum, self._count = np.zeros(0), 0

    def add(self, row: Sequence[float]) -> None:
        if len(row) != len(self._sum):
            self._sum, self._count = np.zeros(len(row)), 0
            self._looks.clear()
        self._sum = self._sum + row
        self._count += 1

    def look(self) -> Array:
        """Mean over the latest looks; none of what has not come in them."""
        self._looks.append((self._sum, self._count))
        self._sum, self._count = np.zeros(len(self._sum)), 0
        count = sum(number for _, number in self._looks)
        return np.sum([total for total, _ in self._looks], axis=0) / count if count else np.zeros(0)


class Gathering:
    """Gathers, and says how it is when it is asked.

    Parameters
    ----------
    points : sequence of str
    nodes : sequence of str
        That have to be there.
    watched : bool
        Whether the alarm is the one that learns what is usual first.
    clock : callable
        Time of the computer, ns.
    steady : callable
        s.
    """

    def __init__(
        self,
        points: Sequence[str],
        nodes: Sequence[str],
        watched: bool,
        clock: Callable[[], int],
        steady: Callable[[], float],
    ) -> None:
        self._clock, self._steady, self._watched = clock, steady, watched
        self._begin, self._begin_at = steady(), iso_time(clock())
        self._nodes: dict[str, _Heard | None] = dict.fromkeys(nodes)
        self._levels = {point: _Levels() for point in points}
        self._measured, self._measured_at = -math.inf, ""
        self._drives: dict[Side, _Means] = {side: _Means() for side in SIDES}
        self._forces: deque[Array] = deque([np.zeros(0)], maxlen=_LOOKS)
        self._verdict: Verdict | None = None
        self._still_since = ""
        self.events: tuple[ListedEvent, ...] = ()
        self.expectation = Expectation({}, "not known yet")
        self.operation: Operation | None = None
        self.context: Context = UNKNOWN
        self.rock, self.machine, self.study, self.learning = "", "", "", "nothing was heard of the watch yet"

    def hear(self, node: str, condition: NodeCondition, text: str) -> None:
        """Take what a node says of itself."""
        if node in self._nodes:
            self._nodes[node] = _Heard(condition, text, iso_time(self._clock()), self._steady())

    def add_window(self, point: str, side: Side, rms: float, apart_s: float) -> None:
        """Add the level of a window (m/s²), which begins so long after the one before."""
        levels = self._levels[point]
        levels.latest[side].append(rms)
        levels.steady = self._steady()
        levels.apart_s = apart_s if apart_s > 0.0 else levels.apart_s
        if side == "field" and not math.isnan(rms):
            self._measured, self._measured_at = levels.steady, iso_time(self._clock())

    def add_torques(self, side: Side, torques: Sequence[float]) -> None:
        """Add the torque of every drive."""
        self._drives[side].add(torques)

    def add_forces(self, largest: Array) -> None:
        """Add the largest force on the teeth of every drive, N."""
        before = self._forces[-1]
        self._forces[-1] = np.maximum(before, largest) if len(before) == len(largest) else largest

    def look(self) -> Now:
        """Say how it is."""
        now, nodes = iso_time(self._clock()), tuple(map(self._node, self._nodes))
        self._verdict = judge(self._situation(now, nodes), self._verdict)
        context = {key: f"{value}" for key, value in asdict(self.context).items() if value is not None}
        return Now.model_validate(
            {
                "time": now,
                "verdict": self._verdict,
                "nodes": nodes,
                "points": tuple(map(self._point, self._levels)),
                "drives": tuple(self._shares()),
                "operation": self.operation,
                "context": context,
                "rock": self.rock,
                "machine": self.machine,
                "study": self.study,
                "limits": dict(self.expectation.limits),
                "limits_are": self.expectation.words,
            }
        )

    def _situation(self, now: str, nodes: Sequence[NodeState]) -> Situation:
        standing = self.operation is not None and self.operation.speed_r_min == 0.0
        self._still_since = (self._still_since or now) if standing else ""
        quiet = self._steady() - max(self._measured, self._begin) > QUIET_S + 3.0 * self._longest_s()
        unseen = (self._measured_at or self._begin_at) if quiet else ""
        learning = self.learning if self._watched else ""
        return Situation(now, nodes, self.events, unseen, self._still_since, learning)

    def _longest_s(self) -> float:
        return max((levels.apart_s for levels in self._levels.values()), default=0.0)

    def _node(self, name: str) -> NodeState:
        heard = self._nodes[name]
        age = self._steady() - (self._begin if heard is None else heard.steady)
        if age > LOST_S:
            text = "says nothing any more" if heard else "was not heard yet"
            return NodeState(name=name, condition="missing", text=text, heard=heard.at if heard else None)
        if heard is None:  # it may just not have spoken yet
            return NodeState(name=name, condition="active", text="not heard yet", heard=None)
        return NodeState(name=name, condition=heard.condition, text=heard.text, heard=heard.at)

    def _point(self, point: str) -> PointState:
        levels = self._levels[point]
        fresh = self._steady() - levels.steady < LOST_S + 3.0 * levels.apart_s
        measured, computed = (levels.rms(side) if fresh else math.nan for side in ("field", "model"))
        standing = [event for event in self.events if event.end is None and event.point == point]
        faults = [_OF_EVENT[event.kind] for event in standing if event.kind in _OF_EVENT]
        condition = faults[0] if faults else self.expectation.condition(point, measured, computed)
        text = "; ".join(event.text for event in standing) or _TEXTS[condition]
        return PointState(
            point=point,
            condition=condition,
            text=text,
            measured=measured,
            computed=computed,
            expected=self.expectation.band(point, computed),
        )

    def _shares(self) -> list[DriveShares]:
        torques = {side: means.look() for side, means in self._drives.items()}
        sizes = [len(found) for found in self._forces]
        forces = np.max([one for one in self._forces if len(one) == max(sizes)], axis=0)
        self._forces.append(np.zeros(0))
        shares = {side: _over_mean(found) for side, found in torques.items()}
        count = max(len(forces), *map(len, shares.values()))
        model, field_, largest = (
            np.concatenate([values, np.full(count - len(values), math.nan)])
            for values in (shares["model"], shares["field"], forces / 1e3)
        )
        return [
            DriveShares(
                drive=drive_name(number + 1),
                computed=float(model[number]),
                measured=float(field_[number]),
                tooth_force_kn=float(largest[number]),
            )
            for number in range(count)
        ]


def _over_mean(torques: Array) -> Array:
    """Torques over the mean of those that are known; none of a machine that rests."""
    known = torques[np.isfinite(torques)]
    mean = float(known.mean()) if known.size else 0.0
    return torques / mean if mean else np.full(len(torques), math.nan)
