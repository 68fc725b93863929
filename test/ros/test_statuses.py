"""What `/diagnostics` says of a comparison, in the order of what matters most."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("diagnostic_msgs")

from diagnostic_msgs.msg import DiagnosticStatus

from tbm_gsa.app.nodes.drive_statuses import drives_status
from tbm_gsa.app.nodes.event_messages import event_status, listed_event
from tbm_gsa.app.nodes.gsa_process import GsaStatus
from tbm_gsa.app.nodes.live_comparison import drive_mapping
from tbm_gsa.app.nodes.statuses import comparison_status, gsa_result_statuses, gsa_status
from tbm_gsa.app.nodes.stream_health import Condition
from tbm_gsa.comparison import WindowResult
from tbm_gsa.comparison.drive_results import DriveResult, DriveSide, DrivesResult, SharingSide
from tbm_gsa.comparison.live_drives import DriveWindow
from tbm_gsa.history import Context, Event, StoredEvent, WindowSource
from tbm_gsa.history.event_list import ListedEvent
from tbm_gsa.sensitivity.results import OutputResult, SpectrumBand, SpectrumResult, StudyResult
from tbm_gsa.sensitivity.study.failures import Failures


def window(model=1.0, field=1.0, rms=1.0):
    level, peak, kurtosis = np.full(3, rms), np.array([4.0, 5.0, 6.0]), np.array([3.0, 7.0, np.nan])
    return WindowResult("girder", 0, 2_000_000_000, np.ones(3), level, np.zeros(3), model, field, peak, kurtosis)


SECOND = 1_000_000_000
SIDE = DriveSide(
    torque=32e3, share=1.0, fluctuation=0.1, peak_factor=1.2, speed=None, speed_fluctuation=None, running=True
)
SHARING = SharingSide(
    running=1, torque=32e3, fluctuation=0.1, sharing_factor=1.0, least_share=1.0, scatter=0.0, correlation=None
)
COMPARED = DrivesResult(
    topic="/tbm/field/drives",
    rate_hz=31.0,
    high_hz=12.4,
    low_pass_hz=None,
    window_s=1.0,
    samples=31,
    windows=1,
    model_windows=1,
    duplicates=0,
    invalid=0,
    field=SHARING,
    model=SHARING,
    drives={"drive_1": DriveResult(field=SIDE, model=SIDE, relative_error=0.0)},
    skipped={},
    findings=(),
)
DRIVES = DriveWindow(0, SECOND, COMPARED)
FOUND = {"findings": ("drive_1 is off",), "skipped": {"drive_2": "not in the recording"}}
ODD = DriveWindow(0, SECOND, COMPARED.model_copy(update=FOUND))
REFUSED = Condition(refused=["block fields: none"], silent=["no signal of the model for 3 s"])
SILENT = Condition(silent=["no signal of the field for 3 s"])
DOUBT = Condition(doubts=["2 publishers"])


@pytest.mark.parametrize(
    ("latest", "alarm", "health", "level", "message"),
    [
        (None, False, Condition(), DiagnosticStatus.STALE, "no window yet"),
        (window(), False, Condition(), DiagnosticStatus.OK, "compared"),
        (window(), True, Condition(), DiagnosticStatus.WARN, "measured level over its threshold"),
        (window(field=0.0), False, Condition(), DiagnosticStatus.STALE, "no signal of the field"),
        (window(model=0.0), True, Condition(), DiagnosticStatus.STALE, "no signal of the model"),
        (window(), True, SILENT, DiagnosticStatus.STALE, "no signal of the field for 3 s"),
        (
            window(),
            True,
            REFUSED,
            DiagnosticStatus.ERROR,
            "block fields: none; no signal of the model for 3 s",
        ),
        (window(), True, DOUBT, DiagnosticStatus.WARN, "measured level over its threshold; 2 publishers"),
        (window(field=0.5), False, Condition(), DiagnosticStatus.WARN, "field covers 50% of the window"),
        (
            window(rms=1.3 / 9.80665),
            False,
            Condition(),
            DiagnosticStatus.WARN,
            "field is about 0.102 times the model on all axes: values in g?",
        ),
        (
            window(rms=0.009),
            False,
            Condition(),
            DiagnosticStatus.WARN,
            "field measures next to nothing along x, y, z: a dead channel?",
        ),
        (
            replace(window(rms=0.009), operation="standstill"),
            False,
            Condition(),
            DiagnosticStatus.OK,
            "not compared: the machine stands still",
        ),
    ],
)
def test_status_of_a_comparison(latest, alarm, health, level, message):
    status = comparison_status("tbm: comparison girder", "girder", latest, None, alarm, health)
    assert (status.level, status.message) == (level, message)
    assert (status.name, status.hardware_id) == ("tbm: comparison girder", "girder")


@pytest.mark.parametrize(
    ("window", "kind", "age", "level", "message"),
    [
        (None, "steady", 0.0, DiagnosticStatus.STALE, "no window yet"),
        (DriveWindow(0, SECOND, None, "no signal"), "steady", 0.0, DiagnosticStatus.WARN, "not compared: no signal"),
        (DRIVES, "steady", 5.0, DiagnosticStatus.OK, "compared"),
        (DRIVES, "steady", 5.1, DiagnosticStatus.STALE, "no window of field and model for 5 s"),
        (ODD, "steady", 0.0, DiagnosticStatus.WARN, "drive_1 is off; drive_2: not in the recording"),
        (ODD, "transient", 0.0, DiagnosticStatus.OK, "not compared: the operating point changes"),
        (ODD, "standstill", 0.0, DiagnosticStatus.OK, "not compared: the machine stands still"),
    ],
)
def test_status_of_the_drives(window, kind, age, level, message):
    status = drives_status("tbm: drives", "dz101", window, kind, age)
    assert (status.level, status.message) == (level, message)
    values = {pair.key: pair.value for pair in status.values}
    if window in (DRIVES, ODD) and age < 5.1:
        assert (values["field_running"], values["drive_1_model_torque"]) == ("1", "32000")
        assert "drive_1_field_speed" not in values  # it is not known


@pytest.mark.parametrize(
    ("stated", "topic", "ratio"),
    [("", "field/drives", 1.0), ("{ratio: 20}", "field/drives", 20.0), ("{topic: /plc/motors}", "/plc/motors", 1.0)],
)
def test_drives_are_those_of_the_namespace_unless_stated(tmp_path, stated, topic, ratio):
    file = tmp_path / "mapping.yaml"
    file.write_text(f"topics: {{}}\ndrives: {stated or '~'}\n")
    for found in [drive_mapping(str(file)), *([] if stated else [drive_mapping("")])]:
        assert (found.topic, found.ratio) == (topic, ratio)


def test_values_of_the_latest_window():
    latest = replace(window(rms=2.0, model=0.9), relative_error=np.array([0.5, np.inf, np.nan]))
    status = comparison_status("tbm: comparison girder", "girder", latest, None, False, Condition())
    values = {pair.key: float(pair.value) for pair in status.values}
    assert values == pytest.approx(
        {
            "alarm": 0.0,
            **{f"model_rms_{axis}": 1.0 for axis in "xyz"},
            **{f"field_rms_{axis}": 2.0 for axis in "xyz"},
            "relative_error_x": 0.5,
            "relative_error_y": np.inf,
            "relative_error_z": np.nan,
            "field_crest_factor_x": 2.0,
            "field_crest_factor_y": 2.5,
            "field_crest_factor_z": 3.0,
            "field_kurtosis_x": 3.0,
            "field_kurtosis_y": 7.0,
            "field_kurtosis_z": np.nan,
            "model_coverage": 0.9,
            "field_coverage": 1.0,
        },
        nan_ok=True,
    )


def test_a_study_in_doubt_says_so():
    numbers = {"surrogate": "krg", "r2_test": None, "first": {"x1": 0.9, "x2": 0.1}, "total": {"x1": 1.0, "x2": 0.2}}
    outputs = {name: OutputResult.model_construct(**numbers, r2_cv=r2) for name, r2 in (("a", 0.9), ("b", 0.03))}
    band = SpectrumBand.model_construct(low=5.0, high=10.0, r2_cv=0.9, total={"x1": 0.2, "x2": 0.9})
    whole = SpectrumResult.model_construct(**numbers, r2_cv=0.8, bands=(band,), components=(None,), held=0.994)
    skipped = {"c": "the output is constant (3)"}
    sound = StudyResult.model_construct(outputs=outputs, spectra={"s": whole}, skipped=skipped)
    said = [(one.level, one.message) for one in gsa_result_statuses("of", "dz101", sound, GsaStatus("finished"))]
    assert said == [
        (DiagnosticStatus.OK, "x1, x2"),
        (DiagnosticStatus.WARN, "not determined: R² 0.03"),
        (DiagnosticStatus.OK, "x2 leads in 5–10 Hz; 1 component holds 99.4% of the variance"),
        (DiagnosticStatus.ERROR, "the output is constant (3)"),
    ]
    failed = Failures(3, 20, 0.15, "ValueError: no", 3, ())
    many = sound.model_copy(update={"failure_summary": failed})
    first, second, *_ = gsa_result_statuses("of", "dz101", many, GsaStatus("finished"))
    assert first.message.startswith("x1, x2; 3 of 20 simulations failed (15%); no half of an input's range stands out")
    values = {pair.key: pair.value for pair in second.values}
    assert (values["determined"], values["r2_test"], values["total_x1"]) == ("False", "nan", "1")
    running = gsa_status("gsa", "dz101", GsaStatus("running", "", 20, 40, 3), {})
    assert (running.level, running.message) == (DiagnosticStatus.WARN, "running; 3 of 20 simulations failed")


AT_NIGHT = Context(-1, 1.5, "III", "night")
EVENTS = [
    (0, Event(0, "silent", "girder", "error", "sensor", "no signal"), ("", None, "")),
    (7, Event(1, "machine", "", "warning", "machine", "x", "6 r/min", 9, "/a b", AT_NIGHT), ("Anna", 10**18, "mended")),
]


@pytest.mark.parametrize(("number", "event", "seen"), EVENTS)
def test_an_event_is_read_back_as_it_was_told(number, event, seen):
    source = WindowSource("live", "/tbm/analysis_node", "", "dz101", "ab" * 32)
    listed = ListedEvent.of(StoredEvent(number, source, event, *seen))
    assert listed_event(event_status("tbm: event", listed)) == listed
    assert listed_event(DiagnosticStatus(name="tbm: event 1", message="of others")) is None
