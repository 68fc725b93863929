"""The result of `tbm-monitor history`: windows, trends by point and axis, baselines; its keys are a contract."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Final, cast

from tbm_gsa.history.baseline import Baseline, ErrorStatistics
from tbm_gsa.history.context import ContextKey
from tbm_gsa.history.entries import SourceKind, StatePart, StoredEntry, StoredState, WindowGroup
from tbm_gsa.history.queries import Queries, Selection
from tbm_gsa.history.spread import Spread
from tbm_gsa.reading import Maybe, Part
from tbm_msgs_py.base.units import R_MIN, iso_time

_BY_SOURCE: Final = ("point", "axis", "machine", "kind")


class TrendSummary(Part):
    """Windows of one point, axis, machine and kind of source: how many, and their relative error.

    `group` is what `by` of the document says of them: empty where it was not known, null without it.
    """

    point: str
    axis: str
    machine: str
    source: SourceKind
    windows: int
    first: str
    last: str
    error_mean: float | None
    error_scatter: float | None
    error_latest: float | None
    group: str | None = None

    @classmethod
    def of(cls, group: WindowGroup) -> TrendSummary:
        """Trend of a group by `_BY_SOURCE`, and what is behind it; a dead sensor has no error."""
        point, axis, machine, kind, *by = group.key
        errors = group.relative_error[group.sound()]
        return cls(
            point=point,
            axis=axis,
            machine=machine,
            source=cast(SourceKind, kind),
            windows=len(group.start_ns),
            first=iso_time(int(group.start_ns[0])),
            last=iso_time(int(group.start_ns[-1])),
            error_mean=float(errors.mean()) if errors.size else None,
            error_scatter=float(errors.std(ddof=1)) if errors.size > 1 else None,
            error_latest=float(errors[-1]) if errors.size else None,
            group=by[0] if by else None,
        )


class ListedWindow(Part):
    """One window at one point and axis, with its source."""

    start: str
    start_ns: int
    length_s: float
    point: str
    axis: str
    field_rms: Maybe
    model_rms: Maybe
    relative_error: Maybe
    field_peak: Maybe
    field_crest_factor: Maybe
    field_kurtosis: Maybe
    coverage: Maybe
    source: SourceKind
    name: str
    machine: str
    ring: int | None = None
    chainage: float | None = None
    rock_class: str | None = None
    shift: str | None = None

    @classmethod
    def of(cls, window: StoredEntry) -> ListedWindow:
        """Window as it is listed."""
        entry, source = window.entry, window.source
        values = asdict(entry)
        length_ns = values.pop("length_ns")
        return cls(
            **values,
            start=iso_time(entry.start_ns),
            length_s=length_ns * 1e-9,
            field_crest_factor=entry.field_crest_factor,
            source=source.kind,
            name=source.name,
            machine=source.machine,
            **asdict(window.context),
        )


class BaselineSummary(Part):
    """A baseline: `points` by point and axis; `source` is the kind of its windows, null in a file of before."""

    name: str
    machine: str
    machine_sha256: str
    source: SourceKind | None
    created: str
    since: str
    until: str
    points: dict[str, dict[str, ErrorStatistics]]

    @classmethod
    def of(cls, baseline: Baseline) -> BaselineSummary:
        """Summary of a baseline."""
        points: dict[str, dict[str, ErrorStatistics]] = {}
        for (point, axis), usual in baseline.usual.items():
            points.setdefault(point, {})[axis] = usual
        return cls(
            name=baseline.name,
            machine=baseline.machine,
            machine_sha256=baseline.machine_sha256,
            source=baseline.kind,
            created=iso_time(baseline.created_ns),
            since=iso_time(baseline.since_ns),
            until=iso_time(baseline.until_ns),
            points=points,
        )


class BaselineList(Part):
    """All baselines of a history, the oldest first."""

    path: str
    baselines: tuple[BaselineSummary, ...]

    @classmethod
    def of(cls, history: Queries) -> BaselineList:
        """Baselines of an open history."""
        return cls(path=str(history.path), baselines=tuple(map(BaselineSummary.of, history.baselines())))


class ListedState(Part):
    """Line of what the watch at a level of operation said last: rock, machine or alarm; times in UTC."""

    start: str
    machine: str
    source: SourceKind
    baseline: str
    speed_r_min: float
    torque_kn_m: float
    thrust_kn: float
    part: StatePart
    name: str
    value: Maybe
    low: Maybe
    high: Maybe
    probability: Maybe
    since: str | None
    text: str

    @classmethod
    def of(cls, state: StoredState) -> ListedState:
        """State as it is listed."""
        watch, entry = state.watch, state.entry
        numbers = asdict(entry)
        since_ns = numbers.pop("since_ns")
        return cls(
            **numbers,
            start=iso_time(state.start_ns),
            machine=watch.machine,
            source=watch.kind,
            baseline=watch.baseline,
            speed_r_min=watch.speed / R_MIN,
            torque_kn_m=watch.torque / 1e3,
            thrust_kn=watch.thrust / 1e3,
            since=None if since_ns is None else iso_time(since_ns),
        )


class HistorySummary(Part):
    """A selection of a history.

    Attributes
    ----------
    path : str
    total : int
        Entries chosen.
    summary : tuple of TrendSummary
        Over all of them.
    windows : tuple of ListedWindow
        The newest ones. Times are ISO 8601 in UTC.
    baselines : tuple of BaselineSummary
        All of them, the oldest first.
    states : tuple of ListedState
        What each watch of rock and machine said last, the newest last.
    note : str
        Why nothing is chosen; empty where something is.
    by : {"ring", "chainage", "rock_class", "shift"}, optional
        Of the context, by which the trends are told apart.
    """

    path: str
    total: int
    summary: tuple[TrendSummary, ...]
    windows: tuple[ListedWindow, ...]
    baselines: tuple[BaselineSummary, ...]
    states: tuple[ListedState, ...] = ()
    note: str = ""
    by: ContextKey | None = None


def history_summary(
    history: Queries, selection: Selection, newest: int, by: ContextKey | None = None
) -> HistorySummary:
    """Summarise a selection; of the windows that are not listed one point and axis at a time is held."""
    windows = tuple(map(ListedWindow.of, history.windows(selection, newest)))
    trends = tuple(map(TrendSummary.of, history.groups(_BY_SOURCE, selection, by)))
    return HistorySummary(
        path=str(history.path),
        total=sum(trend.windows for trend in trends),
        summary=trends,
        windows=windows,
        baselines=BaselineList.of(history).baselines,
        states=tuple(map(ListedState.of, history.states())),
        note="" if trends else why_nothing(history, selection),
        by=by,
    )


def spread_summary(history: Queries, spread: Spread, by: ContextKey | None = None) -> HistorySummary:
    """Summarise the windows of trends, of a long time those that were read; none of them is listed."""
    return HistorySummary(
        path=str(history.path),
        total=spread.count,
        summary=tuple(map(TrendSummary.of, spread.groups)),
        windows=(),
        baselines=BaselineList.of(history).baselines,
        states=tuple(map(ListedState.of, history.states())),
        note=spread.note,
        by=by,
    )


def why_nothing(history: Queries, selection: Selection) -> str:
    """Say which windows there are where a selection chooses none."""
    for what, wider in (
        (
            "no window begins in that time: those of any time",
            replace(selection, since_ns=None, until_ns=None),
        ),
        ("no window meets all that was asked for: those of the history", Selection()),
    ):
        if span := history.span(wider):
            return f"{what} begin from {iso_time(span[0])} to {iso_time(span[1])}"
    return "the history holds no windows"
