"""Rows of Tables 2 and 3 and Figures 5 and 7."""

from collections.abc import Iterator
from typing import Final

from tbm_dynamics.calibration.targets import AXIAL_BAND_HZ, POWER_FLOW
from tbm_dynamics.indicators import UNITS
from tbm_gsa.comparison.results import AxialRow
from tbm_gsa.paper.published import ACCELERATION_LINE_HZ, CUTTERHEAD_PEAK_G, MESH_LINES_HZ, TABLE_2, PointRow
from tbm_gsa.paper.reproduction import verdict
from tbm_gsa.paper.reproduction.readings import Reading
from tbm_gsa.paper.reproduction.response import MULTIPLES, ResponseEvidence
from tbm_gsa.paper.reproduction.result import Row
from tbm_gsa.paper.reproduction.verdict import RowVerdict

_MEANINGS: Final = {
    "RDef": "RMS displacement of the ring gear's mesh node",
    "PAcc": "peak acceleration of the first pinion's mesh node",
    "MF": "mesh force, largest or deviation factor of equation (5)",
}
_NO_POINT: Final = "the recording or the machine has no such test point"


def response_rows(evidence: ResponseEvidence) -> Iterator[Row]:
    """Rows of a reading; what the recording holds and definitions come once, with the machine's own reading.

    What was fitted under the reading is no finding.
    """
    compared = {row.point: row for row in evidence.comparison.result.axial_rows}
    synthetic = evidence.comparison.result.synthetic
    for point, paper in TABLE_2.items():
        yield from _point(evidence.reading, point, paper, compared.get(point), synthetic)
    if evidence.reading.own:
        yield from _outputs(evidence)
    yield from _axial_mode(evidence)
    yield from _lines(evidence)
    yield from _levels(evidence)


def _fit_note(reading: Reading, judged: RowVerdict) -> str:
    if not reading.fitted:
        return "not fitted under this reading"
    return "fitted" if judged == "calibrated" else "fitted, and missed"


def _point(reading: Reading, point: str, paper: PointRow, ours: AxialRow | None, synthetic: bool) -> Iterator[Row]:
    """Table 2: predicted and measured RMS, and the relative error."""
    what, wanted = f"axial acceleration RMS at the {point}", paper.predicted_g
    predicted, measured, error = (
        (ours.predicted_g, ours.measured_g, ours.relative_error) if ours else (None, None, None)
    )
    judged = "differs" if predicted is None else reading.unless_fitted(verdict.level(wanted, predicted))
    note = _NO_POINT if ours is None else _fit_note(reading, judged)
    yield reading.row(f"table2.{point}.predicted", f"{what}, predicted", wanted, predicted, judged, note, "g")
    if reading.own:
        judged, wanted = "given", paper.measured_g
        if not synthetic:
            judged = "differs" if measured is None else verdict.level(wanted, measured)
        note = "the recording is synthetic and scaled to this value" if synthetic else ""
        yield reading.row(f"table2.{point}.measured", f"{what}, measured", wanted, measured, judged, note, "g")
    wanted, what = paper.relative_error, f"relative error at the {point}, equation (4)"
    judged = "differs" if error is None else reading.unless_fitted(verdict.share(wanted, error))
    note = _NO_POINT if error is None else "of the predicted value above and a given measured one"
    yield reading.row(f"table2.{point}.error", what, wanted, error, judged, note)


def _outputs(found: ResponseEvidence) -> Iterator[Row]:
    """Table 3: the outputs at the machine's own operating point, definitions of which the paper gives no value."""
    for name, value in found.indicators.items():
        note = "the table says acceleration, the text displacement: displacement" if name.startswith("RDef") else ""
        what = f"{name}, {_MEANINGS[name.split('_')[0]]}"
        yield found.reading.row(f"table3.{name}", what, "defined", value, "no number", note, UNITS[name])


def _axial_mode(found: ResponseEvidence) -> Iterator[Row]:
    """Figure 5: the axial natural frequency next to the line of the loads, and whether it shows."""
    reading, (low, high) = found.reading, AXIAL_BAND_HZ
    nearest = min(found.axial_hz, key=lambda value: abs(value - ACCELERATION_LINE_HZ), default=None)
    judged = reading.unless_fitted(verdict.between(AXIAL_BAND_HZ, nearest))
    paper, what = f"next to {ACCELERATION_LINE_HZ:g} Hz ({low:g}–{high:g})", "axial natural frequency, undamped"
    yield reading.row("figure5.axial", what, paper, nearest, judged, _fit_note(reading, judged), "Hz")
    peak, inside = found.resonance_hz, [value for value in found.axial_hz if low <= value <= high]
    shows = peak is not None and any(verdict.line(value, peak) == "agrees" for value in inside)
    what = "that frequency is a maximum of the cutterhead's answer to F_x, dampings included"
    paper, ours = "a main frequency of the acceleration", "no maximum there" if peak is None else peak
    note = "" if shows else "the dampings of this reading leave no peak"
    yield reading.row("figure5.axial_shows", what, paper, ours, verdict.statement(shows), note, "Hz")


def _lines(found: ResponseEvidence) -> Iterator[Row]:
    """Figure 5: lines of the axial acceleration and of the mesh force."""
    reading, wanted = found.reading, ACCELERATION_LINE_HZ
    line = found.lines_hz[wanted]
    judged: RowVerdict = "given" if verdict.line(wanted, line) == "agrees" else "differs"
    what = "line of the loads in the cutterhead's axial acceleration"
    note = "the loads bring it: the frequency is Table 1's"
    yield reading.row("figure5.load_line", what, wanted, line, judged, note, "Hz")
    note = "tooth number assumed: the paper names the line, not its frequency"
    for number in range(1, MULTIPLES + 1):
        wanted = number * reading.machine.mesh_frequency
        name, line = "f_m" if number == 1 else f"{number} f_m", found.mesh_lines_hz[wanted]
        what = f"line of the mesh force at {name} = {wanted:.2f} Hz"
        yield reading.row(f"figure5.mesh.{number}", what, name, line, verdict.line(wanted, line), note, "Hz")
    note = "the torque's amplitude at it is assumed"
    for wanted in MESH_LINES_HZ:
        line = found.mesh_lines_hz[wanted]
        what = f"line of the loads at {wanted:g} Hz in the mesh force"
        yield reading.row(f"figure5.mesh.load_{wanted:g}", what, wanted, line, verdict.line(wanted, line), note, "Hz")


def _levels(found: ResponseEvidence) -> Iterator[Row]:
    """Figure 7: range of the acceleration, and its decay along the power flow."""
    reading, peak = found.reading, found.peak_g
    judged = reading.unless_fitted(verdict.level(CUTTERHEAD_PEAK_G, peak))
    note = f"over {found.seconds:g} s; the figure shows about ±4 g" + (
        ", its level was fitted" if reading.fitted else ""
    )
    what = "largest axial acceleration at the cutterhead"
    yield reading.row("figure7.peak", what, CUTTERHEAD_PEAK_G, peak, judged, note, "g")
    there = [found.rms_g[point] for point in POWER_FLOW if point in found.rms_g]
    complete = len(there) == len(POWER_FLOW)
    for axis, name in enumerate("xyz"):
        values = [rms[axis] for rms in there]
        judged = reading.unless_fitted(verdict.falling(values)) if complete else "differs"
        note = _fit_note(reading, judged) if judged == "calibrated" else "" if complete else _NO_POINT
        what, ours = f"RMS along the power flow, {name}", " > ".join(f"{value:.3g}" for value in values)
        yield reading.row(f"figure7.decay.{name}", what, " > ".join(POWER_FLOW), ours, judged, note, "g")
