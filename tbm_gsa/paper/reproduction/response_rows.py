"""Rows of Tables 2 and 3 and Figures 5 and 7."""

from collections.abc import Iterator
from typing import Final

from tbm_dynamics.calibration.targets import AXIAL_BAND_HZ, POWER_FLOW
from tbm_dynamics.indicators import UNITS
from tbm_gsa.comparison.results import AxialRow
from tbm_gsa.paper.reproduction import verdict
from tbm_gsa.paper.reproduction.response import MULTIPLES, ResponseEvidence
from tbm_gsa.paper.reproduction.row import Row, Value
from tbm_gsa.paper.reproduction.verdict import Verdict
from tbm_gsa.paper.vibration import (
    ACCELERATION_LINE_HZ,
    CUTTERHEAD_PEAK_G,
    MESH_LINES_HZ,
    TABLE_2,
    PointRow,
)

_MEANINGS: Final = {
    "RDef": "RMS displacement of the ring gear's mesh node",
    "PAcc": "peak acceleration of the first pinion's mesh node",
    "MF": "mesh force, largest or deviation factor of equation (5)",
}
_NO_POINT: Final = "the recording or the machine has no such test point"


def response_rows(evidence: ResponseEvidence) -> Iterator[Row]:
    """Rows of a reading; what the recording holds and definitions come once, with the machine's own reading."""
    rows = _Rows(evidence)
    yield from rows.table_2()
    if evidence.reading.own:
        yield from rows.table_3()
    yield from rows.figure_5()
    yield from rows.figure_7()


class _Rows:
    """Rows under one reading: what was fitted there is no finding."""

    def __init__(self, evidence: ResponseEvidence) -> None:
        self._found = evidence
        self._reading = evidence.reading

    def _row(
        self,
        stem: str,
        source: str,
        what: str,
        paper: Value,
        ours: Value,
        judged: Verdict,
        note: str = "",
        unit: str = "",
    ) -> Row:
        identity = self._reading.id(stem)
        return Row(identity, source, what, paper, ours, judged, note, unit, self._reading.name)

    def _fitted(self, judged: Verdict) -> Verdict:
        return verdict.fitted(judged, self._reading.fitted)

    def table_2(self) -> Iterator[Row]:
        """Predicted and measured RMS, and the relative error."""
        compared = {row.point: row for row in self._found.comparison.result.axial_rows}
        for point, paper in TABLE_2.items():
            yield from self._point(point, paper, compared.get(point))

    def _point(self, point: str, paper: PointRow, ours: AxialRow | None) -> Iterator[Row]:
        stem, predicted = f"table2.{point}", None if ours is None else ours.predicted_g
        judged = "differs" if predicted is None else self._fitted(verdict.level(paper.predicted_g, predicted))
        yield self._row(
            f"{stem}.predicted",
            "Table 2",
            f"axial acceleration RMS at the {point}, predicted",
            paper.predicted_g,
            predicted,
            judged,
            _NO_POINT if ours is None else self._fit_note(judged),
            "g",
        )
        if self._reading.own:
            yield self._measured(stem, point, paper, ours)
        error = None if ours is None else ours.relative_error
        yield self._row(
            f"{stem}.error",
            "Table 2",
            f"relative error at the {point}, equation (4)",
            paper.relative_error,
            error,
            "differs" if error is None else self._fitted(verdict.share(paper.relative_error, error)),
            _NO_POINT if error is None else "of the predicted value above and a given measured one",
        )

    def _measured(self, stem: str, point: str, paper: PointRow, ours: AxialRow | None) -> Row:
        synthetic = self._found.comparison.result.synthetic
        measured = None if ours is None else ours.measured_g
        judged: Verdict = "given"
        if not synthetic:
            judged = "differs" if measured is None else verdict.level(paper.measured_g, measured)
        note = "the recording is synthetic and scaled to this value" if synthetic else ""
        what = f"axial acceleration RMS at the {point}, measured"
        return self._row(f"{stem}.measured", "Table 2", what, paper.measured_g, measured, judged, note, "g")

    def _fit_note(self, judged: Verdict) -> str:
        if not self._reading.fitted:
            return "not fitted under this reading"
        return "fitted" if judged == "calibrated" else "fitted, and missed"

    def table_3(self) -> Iterator[Row]:
        """Give the outputs at the machine's own operating point: definitions, of which the paper gives no value."""
        for name, value in self._found.indicators.items():
            note = "the table says acceleration, the text displacement: displacement" if name.startswith("RDef") else ""
            what = f"{name}, {_MEANINGS[name.split('_')[0]]}"
            yield self._row(f"table3.{name}", "Table 3", what, "defined", value, "no number", note, UNITS[name])

    def figure_5(self) -> Iterator[Row]:
        """Lines of the axial acceleration and of the mesh force."""
        found, (low, high) = self._found, AXIAL_BAND_HZ
        inside = [value for value in found.axial_hz if low <= value <= high]
        nearest = min(found.axial_hz, key=lambda value: abs(value - ACCELERATION_LINE_HZ), default=None)
        judged = self._fitted(verdict.between(AXIAL_BAND_HZ, nearest))
        next_to = f"next to {ACCELERATION_LINE_HZ:g} Hz ({low:g}–{high:g})"
        what = "axial natural frequency, undamped"
        yield self._row("figure5.axial", "Figure 5", what, next_to, nearest, judged, self._fit_note(judged), "Hz")
        shows = found.resonance_hz is not None and any(
            verdict.line(value, found.resonance_hz) == "agrees" for value in inside
        )
        yield self._row(
            "figure5.axial_shows",
            "Figure 5",
            "that frequency is a maximum of the cutterhead's answer to F_x, dampings included",
            "a main frequency of the acceleration",
            found.resonance_hz if found.resonance_hz is not None else "no maximum there",
            verdict.statement(shows),
            "" if shows else "the dampings of this reading leave no peak",
            "Hz",
        )
        line = found.lines_hz[ACCELERATION_LINE_HZ]
        judged = verdict.line(ACCELERATION_LINE_HZ, line)
        what = "line of the loads in the cutterhead's axial acceleration"
        note = "the loads bring it: the frequency is Table 1's"
        judged = "given" if judged == "agrees" else judged
        yield self._row("figure5.load_line", "Figure 5", what, ACCELERATION_LINE_HZ, line, judged, note, "Hz")
        yield from self._mesh_lines()

    def _mesh_lines(self) -> Iterator[Row]:
        found, frequency = self._found.mesh_lines_hz, self._reading.machine.mesh_frequency
        for number in range(1, MULTIPLES + 1):
            wanted = number * frequency
            name = "f_m" if number == 1 else f"{number} f_m"
            what = f"line of the mesh force at {name} = {wanted:.2f} Hz"
            judged = verdict.line(wanted, found[wanted])
            note = "tooth number assumed: the paper names the line, not its frequency"
            yield self._row(f"figure5.mesh.{number}", "Figure 5", what, name, found[wanted], judged, note, "Hz")
        for wanted in MESH_LINES_HZ:
            judged = self._fitted(verdict.line(wanted, found[wanted]))
            what = f"line of the loads at {wanted:g} Hz in the mesh force"
            note = "the torque's amplitude at it was fitted so that it shows" if self._reading.fitted else ""
            yield self._row(
                f"figure5.mesh.load_{wanted:g}", "Figure 5", what, wanted, found[wanted], judged, note, "Hz"
            )

    def figure_7(self) -> Iterator[Row]:
        """Range of the acceleration, and its decay along the power flow."""
        peak = self._found.peak_g
        judged = self._fitted(verdict.level(CUTTERHEAD_PEAK_G, peak))
        what = "largest axial acceleration at the cutterhead"
        note = f"over {self._found.seconds:g} s; the figure shows about ±4 g, its level was fitted"
        if not self._reading.fitted:
            note = f"over {self._found.seconds:g} s; the figure shows about ±4 g"
        yield self._row("figure7.peak", "Figure 7", what, CUTTERHEAD_PEAK_G, peak, judged, note, "g")
        flow = " > ".join(POWER_FLOW)
        missing = [point for point in POWER_FLOW if point not in self._found.rms_g]
        for axis, name in enumerate("xyz"):
            values = [self._found.rms_g[point][axis] for point in POWER_FLOW if point not in missing]
            ours = " > ".join(f"{value:.3g}" for value in values)
            judged = "differs" if missing else self._fitted(verdict.falling(values))
            what = f"RMS along the power flow, {name}"
            note = _NO_POINT if missing else self._fit_note(judged) if judged == "calibrated" else ""
            yield self._row(f"figure7.decay.{name}", "Figure 7", what, flow, ours, judged, note, "g")
