"""The HTML page of the history, and its trends as a picture."""

import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave

from tbm_gsa.app.report.history_figures import by_trend, trends
from tbm_gsa.app.report.page import embed_figure, render_page
from tbm_gsa.history.baseline import Baseline
from tbm_gsa.history.entries import Window
from tbm_gsa.history.summary import baseline_document, iso_time, summarise
from tbm_gsa.provenance import package_versions


def history_page(path: Path, windows: Sequence[Window], baselines: Sequence[Baseline]) -> str:
    """Render windows in the order of time as a page that holds its figures and style.

    The newest baseline of each machine is drawn.
    """
    what = "RMS, relative error, crest factor and kurtosis"
    figures = [
        {"name": name, "figure": embed_figure(figure, f"{what} of {name} over time"), "baseline": baseline}
        for name, figure, baseline in _figures(windows, baselines)
    ]
    begin, end = iso_time(windows[0].entry.start_ns), iso_time(windows[-1].entry.start_ns)
    names = sorted({window.source.name for window in windows})
    context = {
        "title": "History of the comparison",
        "subtitle": f"{len(windows)} entries from {begin} to {end}",
        "figures": figures,
        "summary": summarise(windows),
        "baselines": [baseline_document(one) for one in baselines],
        "provenance": {
            "history": str(path),
            "sources": ", ".join(names),
            "versions": ", ".join(f"{name} {number}" for name, number in package_versions().items()),
        },
    }
    return render_page("history.html", context)


def history_picture(windows: Sequence[Window], baselines: Sequence[Baseline]) -> bytes:
    """Draw all trends, one below the other, as PNG."""
    pictures = [_pixels(figure) for _, figure, _ in _figures(windows, baselines)]
    buffer = io.BytesIO()
    imsave(buffer, np.concatenate(pictures), format="png")
    return buffer.getvalue()


def _figures(windows: Sequence[Window], baselines: Sequence[Baseline]) -> Iterator[tuple[str, Figure, Baseline | None]]:
    """Name, figure and baseline of every trend."""
    newest = {one.machine: one for one in baselines}
    for name, members in by_trend(windows).items():
        baseline = newest.get(members[0].source.machine)
        yield name, trends(name, members, baseline), baseline


def _pixels(figure: Figure) -> np.ndarray:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
