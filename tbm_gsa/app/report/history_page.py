"""The HTML page of the history, and its trends as a picture."""

import io
from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave

from tbm_gsa.app.report.history_figures import by_trend, trends
from tbm_gsa.app.report.page import PageHead, PageMachine, embed_figure, render_page
from tbm_gsa.history.entries import StoredEntry
from tbm_gsa.history.summary import BaselineSummary, HistorySummary
from tbm_gsa.provenance import package_versions, versions_text
from tbm_msgs_py.base.units import iso_time


def history_page(found: HistorySummary, windows: Sequence[StoredEntry]) -> str:
    """Render windows in the order of time as a page that holds its figures and style.

    The newest baseline of each machine is drawn.
    """
    what = "RMS, relative error, crest factor and kurtosis"
    figures = [
        {"name": name, "figure": embed_figure(figure, f"{what} of {name} over time"), "baseline": baseline}
        for name, figure, baseline in _figures(found, windows)
    ]
    begin, end = iso_time(windows[0].entry.start_ns), iso_time(windows[-1].entry.start_ns)
    machines = {window.source.machine for window in windows}
    sources = {window.source for window in windows}
    head = PageHead(
        title="History of the comparison",
        subtitle=f"{len(windows)} entries",
        data=f"windows that begin from {begin} to {end}",
        units="accelerations in m/s²; errors in % of the measured RMS",
        machines=tuple(
            PageMachine(*named) for named in sorted({(s.machine, s.machine, s.machine_sha256) for s in sources})
        ),
    )
    context = {
        "figures": figures,
        "summary": found.summary,
        "by": found.by,
        "baselines": [one for one in found.baselines if one.machine in machines],
        "provenance": {
            "history": found.path,
            "sources": ", ".join(sorted({window.source.name for window in windows})),
            "versions": versions_text(package_versions()),
        },
    }
    return render_page("history.html", head, context)


def history_picture(found: HistorySummary, windows: Sequence[StoredEntry]) -> bytes:
    """Draw all trends, one below the other, as PNG."""
    buffer = io.BytesIO()
    imsave(buffer, np.concatenate([_pixels(figure) for _, figure, _ in _figures(found, windows)]), format="png")
    return buffer.getvalue()


def _figures(
    found: HistorySummary, windows: Sequence[StoredEntry]
) -> Iterator[tuple[str, Figure, BaselineSummary | None]]:
    """Name, figure and baseline of every trend."""
    newest = {one.machine: one for one in found.baselines}
    for name, members in by_trend(windows).items():
        baseline = newest.get(members[0].source.machine)
        yield name, trends(name, members, baseline), baseline


def _pixels(figure: Figure) -> np.ndarray:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
