"""The page of an explanation: its result → one HTML file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tbm_gsa.app.report.page import PageHead, PageMachine, embed_figure, recorded_at, render_page
from tbm_gsa.explanation.result import Explanation, Joint, JointInput
from tbm_gsa.provenance import versions_text
from tbm_gsa.sensitivity.study.distributions import LogUniform
from tbm_gsa.sensitivity.study.inputs import known_input
from tbm_msgs_py.base.files import write_whole
from tbm_msgs_py.base.units import STANDARD_GRAVITY

BEFORE, AFTER, RANGE = "#D55E00", "#0072B2", "#d8dee6"


def write_explanation_page(found: Explanation, path: Path) -> None:
    """Write the page of an explanation."""
    write_whole(path, explanation_page(found).encode())


def explanation_page(found: Explanation) -> str:
    """Render the page of an explanation; everything in it is escaped."""
    head = PageHead(
        title="Rock, machine or sensor",
        subtitle=f"{Path(found.recording.path).name} against {found.machine}",
        data=recorded_at(found.recording.begin),
        units="accelerations in m/s², noise of sensors in mm/s²/√Hz with µg/√Hz beside it; "
        f"1 g = {STANDARD_GRAVITY:g} m/s²",
        machines=(PageMachine.of(found.machine, found.machine_file),),
    )
    context = {
        "found": found,
        "gravity": STANDARD_GRAVITY,
        "before_after": embed_figure(before_after(found), "Field over model before and after, every band RMS"),
        "joint": embed_figure(joint_intervals(found.joint), "Intervals of all inputs"),
        "provenance": _provenance(found),
    }
    return render_page("explanation.html", head, context)


def before_after(found: Explanation) -> Figure:
    """Field over model of every band RMS, as the machine stands and as the verdict has it, and what may be expected."""
    rows = found.statistics
    figure = Figure(figsize=(12.0, 1.0 + 0.16 * len(rows)), layout="constrained")
    panel: Axes = figure.subplots()
    place = np.arange(len(rows), dtype=np.float64)
    deviation = np.array([row.deviation for row in rows])
    panel.barh(place, 4.0 * deviation, left=-2.0 * deviation, height=0.8, color=RANGE, label="±2 standard deviations")
    for key, colour, label in (
        ("model", BEFORE, "machine as it stands"),
        ("predicted", AFTER, "with the verdict"),
    ):
        ratio = np.log([row.field / getattr(row, key) for row in rows])
        panel.plot(ratio, place, "o", color=colour, markersize=4, label=label)
    panel.axvline(0.0, color="#555555", linewidth=0.8)
    panel.set_yticks(place, [row.name for row in rows], fontsize=7)
    panel.invert_yaxis()
    panel.margins(y=0.01)
    panel.set_xlabel("logarithm of field over model")
    panel.legend(frameon=False, loc="lower right", fontsize=8)
    return figure


def joint_intervals(joint: Joint) -> Figure:
    """90 % intervals of all inputs over the ranges that were searched, each in the space of its distribution."""
    inputs = joint.inputs
    figure = Figure(figsize=(12.0, 0.8 + 0.24 * len(inputs)), layout="constrained")
    panel: Axes = figure.subplots()
    for place, row in enumerate(inputs.values()):
        begin, end, own = row.shares()
        panel.barh(place, 1.0, height=0.75, color=RANGE)
        panel.barh(place, end - begin, left=begin, height=0.45, color=AFTER)
        panel.plot([own, own], [place - 0.38, place + 0.38], color=BEFORE, linewidth=1.5)
    panel.set_yticks(range(len(inputs)), [_range_label(code, row) for code, row in inputs.items()], fontsize=8)
    panel.invert_yaxis()
    panel.set_xlim(0.0, 1.0)
    panel.set_xlabel("share of the range searched, from lower to upper bound (log: of its logarithm)")
    return figure


def _range_label(code: str, row: JointInput) -> str:
    log = ", log" if row.distribution == LogUniform.name else ""
    item = known_input(code)
    return f"{code} {item.symbol}: {row.lower:.3g} to {row.upper:.3g} {item.unit}".rstrip() + log


def _provenance(found: Explanation) -> dict[str, object]:
    chosen, joint = found.settings, found.joint
    return {
        "recording": f"{found.recording.path}, sha256 {found.recording.sha256}",
        "machine": f"{found.machine_file.origin}, sha256 {found.machine_file.sha256}",
        "operating point": ", ".join(f"{key} {value}" for key, value in found.operating_point),
        "check": f"run of {chosen.duration:g} s, seed {chosen.seed}",
        "joint posterior": f"{joint.effective_samples:.0f} effective samples, "
        f"{joint.accepted:.0%} of the steps accepted",
        "versions": versions_text(found.versions),
    }
