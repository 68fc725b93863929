"""The HTML page of the history, and its trends as a picture."""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave

from tbm_gsa.history.baseline import Baseline
from tbm_gsa.history.entries import Window
from tbm_gsa.history.summary import baseline_document, iso_time, summarise
from tbm_gsa.provenance import package_versions
from tbm_gsa.report.history_figures import by_point, trends
from tbm_gsa.report.page import embed_figure, render_page


def history_page(path: Path, windows: Sequence[Window], baselines: Sequence[Baseline]) -> str:
    """Render windows in the order of time as a page that holds its figures and style; the newest baseline is drawn."""
    baseline = baselines[-1] if baselines else None
    figures = {
        point: embed_figure(
            trends(point, members, baseline), f"RMS, relative error, crest factor and kurtosis of {point} over time"
        )
        for point, members in by_point(windows).items()
    }
    begin, end = iso_time(windows[0].entry.start_ns), iso_time(windows[-1].entry.start_ns)
    names = sorted({window.source.name for window in windows})
    context = {
        "title": "History of the comparison",
        "subtitle": f"{len(windows)} entries from {begin} to {end}",
        "figures": figures,
        "baseline": baseline,
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
    """Draw the trends of every test point, one below the other, as PNG."""
    baseline = baselines[-1] if baselines else None
    pictures = [_pixels(trends(point, members, baseline)) for point, members in by_point(windows).items()]
    buffer = io.BytesIO()
    imsave(buffer, np.concatenate(pictures), format="png")
    return buffer.getvalue()


def _pixels(figure: Figure) -> np.ndarray:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
