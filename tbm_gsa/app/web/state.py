"""What the page is told, section by section; times are ISO 8601 in UTC, m/s² and Hz, null where nothing is known."""

from __future__ import annotations

from typing import Final, Literal

from tbm_gsa.comparison.results import ExpectedLine
from tbm_gsa.comparison.streams import Side
from tbm_gsa.history.context import ContextKey
from tbm_gsa.history.event_list import ListedEvent
from tbm_gsa.reading import Maybe, Part

VerdictKind = Literal["no_data", "machine", "sensor", "level", "still", "rock", "learning", "well"]
PointCondition = Literal["within", "above", "below", "dead", "silent", "faulty", "unknown"]
NodeCondition = Literal["active", "faulty", "inactive", "missing"]
TrendSpan = Literal["hour", "day", "week"]
TREND_SPANS: Final[dict[TrendSpan, tuple[int, int]]] = {"hour": (60, 60), "day": (900, 96), "week": (7200, 84)}
"""Length of a bin (s), and how many of them."""


class Verdict(Part):
    """How it is, in words, since when, and what else stands."""

    kind: VerdictKind
    title: str
    text: str
    since: str | None
    also: tuple[str, ...] = ()


class NodeState(Part):
    """A node as it was heard last; `heard` is null of one that never was."""

    name: str
    condition: NodeCondition
    text: str
    heard: str | None


class Band(Part):
    """Expected level of a point (m/s²); NaN, in JSON null, where it is not known."""

    low: Maybe
    high: Maybe


class Limits(Part):
    """Limits of measured over computed RMS."""

    low: float
    high: float


class PointState(Part):
    """Axial level of a test point in the latest window (RMS, m/s²), measured and computed, and what is expected."""

    point: str
    condition: PointCondition
    text: str
    measured: Maybe
    computed: Maybe
    expected: Band


class DriveShares(Part):
    """Torque of a drive over the mean of all, computed and measured, and its largest tooth force (kN)."""

    drive: str
    computed: Maybe
    measured: Maybe
    tooth_force_kn: Maybe


class Operation(Part):
    """How the machine is driven."""

    speed_r_min: float
    torque_kn_m: float
    thrust_kn: float


class Now(Part):
    """Everything that changes by the second; the limits are those between which a level is expected."""

    time: str
    verdict: Verdict
    nodes: tuple[NodeState, ...]
    points: tuple[PointState, ...]
    drives: tuple[DriveShares, ...]
    operation: Operation | None
    context: dict[ContextKey, str]
    rock: str
    machine: str
    study: str
    limits: dict[str, Limits]
    limits_are: str


class SpectrumRow(Part):
    """Axial spectra of one span of time at all points, coded by `spectra.coded`."""

    time: str
    step_hz: float
    points: dict[str, dict[Side, str]]


class Waterfall(Part):
    """The rows of the last minutes at one point."""

    point: str
    rows: tuple[SpectrumRow, ...]


class TrendBin(Part):
    """Measured over computed RMS of so many windows: 5 %, median and 95 %; and their median level (m/s²)."""

    begin: str
    windows: int
    low: float
    median: float
    high: float
    level: float


class Trend(Part):
    """Axial trend by test point over a span of time; bins without a window are left out."""

    span: TrendSpan
    bin_s: int
    bins: int
    end: str
    problem: str
    points: dict[str, tuple[TrendBin, ...]]


class Events(Part):
    """Newest events, the oldest first."""

    events: tuple[ListedEvent, ...]


class Shape(Part):
    """Part of the machine in its side view: from the face to the rear, and from bottom to top (m)."""

    kind: Literal["head", "structure", "drive"]
    x: float
    y: float
    width: float
    height: float


class Place(Part):
    """Place of a test point in the side view (m)."""

    point: str
    x: float
    y: float


class Picture(Part):
    """Side view of the machine: what is drawn, and where the test points are."""

    shapes: tuple[Shape, ...]
    places: tuple[Place, ...]


class Setup(Part):
    """What a page needs once: the machine, its picture, its expected lines, and the word that lets it write.

    `version` is that of the page's own files: a page that was loaded from others loads itself again.
    """

    version: str
    machine: str
    title: str
    points: tuple[str, ...]
    picture: Picture
    mesh_hz: float
    high_hz: float
    lines: tuple[ExpectedLine, ...]
    token: str
    acknowledging: bool


class LinkedPage(Part):
    """A page of a study, an explanation or a comparison in the run's folder."""

    key: str
    title: str
    file: str
    written: str


class PageList(Part):
    """Pages, the newest first."""

    pages: tuple[LinkedPage, ...]


class Acknowledgement(Part):
    """What a person says of an event."""

    id: int
    by: str
    comment: str = ""
    replace: bool = False
