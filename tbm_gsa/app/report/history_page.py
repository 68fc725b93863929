"""The HTML page of the history, and its trends as a picture."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave

from tbm_gsa.app.report.history_figures import Trend, by_trend, trends
from tbm_gsa.app.report.page import PageHead, PageMachine, embed_figure, machine_of, render_page
from tbm_gsa.comparison.alarm import SCATTERS
from tbm_gsa.history.event_list import ListedEvent
from tbm_gsa.history.events import StoredEvent
from tbm_gsa.history.spread import Spread
from tbm_gsa.history.summary import BaselineSummary, HistorySummary
from tbm_gsa.provenance import package_versions, versions_text
from tbm_msgs_py.base.units import iso_time
from tbm_msgs_py.topics import ERROR_THRESHOLD

EVENTS_LISTED: Final = 50


def history_page(found: HistorySummary, spread: Spread, events: Sequence[StoredEvent]) -> str:
    """Render the trends of a selection as a page that holds its figures and style.

    The newest baseline of each machine gives the limits; of the events the newest are listed.
    """
    machines = _machines(spread)
    what = "RMS, its ratio to the model's, crest factor and kurtosis"
    figures = [
        {"name": name, "figure": embed_figure(figure, f"{what} of {name} over time"), "baseline": usual, "events": own}
        for name, figure, usual, own in _figures(found, spread, events)
    ]
    head = PageHead(
        title="History of the comparison",
        subtitle=f"{Path(found.path).name}, {spread.count} windows",
        data=f"windows that begin from {iso_time(spread.first_ns)} to {iso_time(spread.last_ns)}",
        units="accelerations in m/s², times in UTC",
        machines=machines,
    )
    context = {
        "figures": figures,
        "note": spread.note,
        "threshold": ERROR_THRESHOLD,
        "scatters": SCATTERS,
        "summary": found.summary,
        "by": found.by,
        "events": [ListedEvent.of(event) for event in events[-EVENTS_LISTED:]][::-1],
        "more_events": max(0, len(events) - EVENTS_LISTED),
        "baselines": [one for one in found.baselines if one.machine in {machine.name for machine in machines}],
        "provenance": {
            "history": found.path,
            "sources": ", ".join(sorted({source.name for source in spread.sources})),
            "versions": versions_text(package_versions()),
        },
    }
    return render_page("history.html", head, context)


def history_picture(found: HistorySummary, spread: Spread, events: Sequence[StoredEvent]) -> bytes:
    """Draw all trends, one below the other, as PNG."""
    buffer = io.BytesIO()
    pixels = [_pixels(figure) for _, figure, *_ in _figures(found, spread, events)]
    imsave(buffer, np.concatenate(pixels), format="png")
    return buffer.getvalue()


def _machines(spread: Spread) -> tuple[PageMachine, ...]:
    """Machines of the windows; the history does not know where their files are, only what is in them."""
    named = sorted({(source.machine, source.machine_sha256) for source in spread.sources})
    return tuple(PageMachine(name, name, digest) for name, digest in named)


def _figures(
    found: HistorySummary, spread: Spread, events: Sequence[StoredEvent]
) -> Iterator[tuple[str, Figure, BaselineSummary | None, list[StoredEvent]]]:
    """Name, figure, baseline and events of every trend, in the order of the power flow."""
    newest = {one.machine: one for one in found.baselines}
    every = _in_order(by_trend(spread.groups), _machines(spread))
    mixed = len({(trend.machine, trend.kind) for trend in every}) > 1
    for trend in every:
        name = f"{trend.point}, {trend.kind}, {trend.machine}" if mixed else trend.point
        baseline = newest.get(trend.machine)
        usual = baseline.points.get(trend.point, {}) if baseline else {}
        own = [one for one in events if _is_of(one, trend)]
        yield name, trends(trend, name, spread.edges_ns(), usual, own), baseline, own


def _in_order(found: Sequence[Trend], machines: Sequence[PageMachine]) -> list[Trend]:
    """Trends by machine and kind, their points along the power flow; those of an unknown machine by name."""
    known = {one.name: machine.description.test_points for one in machines if (machine := machine_of(one))}
    places = {(name, point): place for name, points in known.items() for place, point in enumerate(points)}
    last = len(places)
    return sorted(found, key=lambda one: (one.machine, one.kind, places.get((one.machine, one.point), last), one.point))


def _is_of(one: StoredEvent, trend: Trend) -> bool:
    """Whether an event is one of a trend's machine and source, and of its point or of no point alone."""
    same = (one.source.machine, one.source.kind) == (trend.machine, trend.kind)
    return same and one.event.point in ("", trend.point)


def _pixels(figure: Figure) -> np.ndarray:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
