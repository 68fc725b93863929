"""The page of a comparison and the command that writes it."""

import json
import re
from functools import partial

import numpy as np
import pytest
import typer
from compare_bags import noise, write_bag, write_drives
from here import pictures_without_layout
from report_pages import Page, check_page, check_widths
from typer.testing import CliRunner

from tbm_dynamics import MachineError
from tbm_gsa.app.cli.bag.info import info
from tbm_gsa.app.cli.compare import compare
from tbm_gsa.app.report import compare_figures
from tbm_gsa.app.report.compare_page import compare_page
from tbm_gsa.app.report.svg import inline_svg
from tbm_gsa.comparison import ComparisonResult, Settings
from tbm_gsa.comparison.workflow import compare_recording
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_msgs_py import RecordingError
from tbm_msgs_py.base.errors import InputError

MADE = "1790000000"
HOSTILE = "<b>x$y_{"

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
app.command()(compare)


@pytest.fixture(scope="module", autouse=True)
def _drawn_fast():
    with pictures_without_layout():
        yield


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    points = {"cutterhead": noise(6.0, 5.0), "shield": noise(6.0), "belt": noise(2.0)}
    torque = 32e3 * np.random.default_rng(2).normal(1.0, 0.02, (60, 10)) * (np.arange(10) != 6)
    more = partial(write_drives, torque=torque, rate=10, speed=np.full_like(torque, 5.571))
    path = write_bag(tmp_path_factory.mktemp("bag") / "bag", points, more=more)
    sensors = {point: {"units": "m/s2", "gravity": "removed", "frame": "fixed", "point": point} for point in points}
    sensors["shield"]["axes"] = [None, "y", "z"]
    mapping = {"topics": {f"/tbm/field/{point}/block": sensor for point, sensor in sensors.items()}}
    (path / "mapping.yaml").write_text(json.dumps(mapping))
    return path


@pytest.fixture(scope="module")
def compared(bag):
    return compare_recording(bag, model_duration=2.0, settings=Settings(spectrogram=True))


@pytest.fixture(scope="module")
def result(compared):
    return compared.result


@pytest.fixture(scope="module")
def text(compared):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOURCE_DATE_EPOCH", MADE)
        return compare_page(compared)


def run(*arguments):
    return CliRunner().invoke(app, [*map(str, arguments), "--model-duration", "2"])


def test_the_page_holds_everything_itself(text):
    page = check_page(text)
    assert page.tags.count("svg") == 7
    assert page.tags.count("image") == 2 + 1  # spectrograms of the point that has an axial axis, and the scale
    assert "b" not in page.tags
    assert "<dd>recorded from 2023-11-14T22:13:20.000Z, 5.9995 s</dd>" in text
    check_widths(text)


def test_a_scan_says_what_of_the_drives_is_there(bag, capsys):
    info(bag, scan=True)
    assert (
        "drives /tbm/field/drives: 60 samples, 10 Hz, torque of 10 drives, speed of 10 drives"
        in capsys.readouterr().out
    )
    info(bag, scan=True, json=True)
    drives = json.loads(capsys.readouterr().out)["drives"]
    assert (drives["duration"], drives["torque"]["drive_7"]) == (pytest.approx(5.9), 1.0)


def test_an_axis_that_was_not_measured_is_a_dash(text):
    rows = [re.sub("<[^>]*>", " ", row).split() for row in text.split("<tr>")]
    axial, each, _bands = (row for row in rows if row[:2] in (["shield", "43"], ["shield", "axial,"]))
    assert (axial[4:8], each[3:9]) == (["–"] * 4, ["–"] * 6)
    assert ["shield", "/tbm/field/shield/block", "2000.000", "100.000", "%"] in [row[:5] for row in rows]


def test_the_page_says_what_the_document_says(result, text):
    head = result.points["cutterhead"]["x"]
    assert f"<td>{head.model_rms_g:.3f}</td>" in text
    assert f"<td>{head.field_rms_g:.3f}</td>" in text
    assert f"{head.relative_error:.0%}".replace("%", " %") in text
    assert result.recording.sha256 in text
    assert MachineEvaluation.of("dz101", 1.0, 0).settings["machine_sha256"] in text  # as a study names the machine
    assert "Test point belt was not compared: machine dz101 has no such test point." in text
    assert "synthetic" not in text


def test_the_page_says_how_the_drives_share(result, text):
    seventh, drives = result.drives.drives["drive_7"], result.drives
    rows = [re.sub("<[^>]*>", " ", row).split() for row in text.split("<tr>")]
    (row,) = (row for row in rows if row[:1] == ["drive_7"])
    assert row[1:4] == ["0", "(off)", f"{seventh.model.torque / 1000:.4g}"]
    assert ["Drives", "that", "run", "9", "10"] in [row[:5] for row in rows]
    assert any(row[-2:] == [f"{drives.field.sharing_factor:.3f}", f"{drives.model.sharing_factor:.3f}"] for row in rows)
    assert "Drive_7 is off in the recording, with 0.00% of the mean, and runs in the model" in text


def test_names_of_others_and_kinds_of_sensors_and_recordings(tmp_path):
    mapping = tmp_path / "points.yaml"
    names = {"a": "cutterhead", "b": HOSTILE, "c": "<i>unknown", "d": "girder"}
    sensor = "units: m/s2, gravity: included"
    mapping.write_text(
        "topics:\n"
        + "".join(
            f'  /tbm/field/{a}/block: {{point: "{p}", {sensor}, frame: {"rotating" if a == "a" else "fixed"}}}\n'
            for a, p in names.items()
        )
    )
    path = write_bag(tmp_path / "<u>bag", {name: noise(3.0) for name in names}, custom_data={"synthetic": "true"})
    compared = compare_recording(path, "dz101", mapping, model_duration=2.0)
    text = compare_page(compared)
    assert list(compared.result.points) == ["cutterhead", "girder"]
    assert not {"b", "i", "u"} & set(Page(text).tags)
    for name in (HOSTILE, "<i>unknown", "<u>bag"):
        assert name not in text
        assert name.replace("<", "&lt;").replace(">", "&gt;") in text
    assert "This recording is synthetic" in text
    assert "across, √(y² + z²)" in text


def test_a_silent_sensor_and_a_window_that_does_not_fit(tmp_path):
    path = write_bag(tmp_path / "bag", {"shield": noise(3.0, 0.0)})
    compared = compare_recording(path, "open380", model_duration=2.0, settings=Settings(window_s=60.0))
    assert compared.result.points["shield"]["x"].relative_error is None
    page = compare_page(compared)
    assert "No window of 60 s fits into the recording." in page
    # Of another machine, the page says nothing of the paper's.
    assert all(f"{band} Hz" in page for band in ("0.5 to 20", "16 to 21", "60 to 120", "336 to 414"))
    assert not [word for word in ("paper", "Table", "dz101", "125 to 135") if word in page]


def test_windows_of_a_day_are_medians_of_its_parts(result):
    axis = result.points["cutterhead"]["x"]
    rms = np.random.default_rng(5).lognormal(size=43_200)
    columns = {"start": 2.0 * np.arange(len(rms)), "field_rms": rms, "relative_error": rms, "level": [0] * len(rms)}
    windows = axis.windows.model_copy(update={name: tuple(values) for name, values in columns.items()})
    point = {"x": axis.model_copy(update={"windows": windows})}
    figure = compare_figures.windows(result.model_copy(update={"points": {"cutterhead": point}}))
    drawn = figure.axes[0].lines[1].get_ydata()
    np.testing.assert_allclose(drawn, np.median(rms.reshape(300, -1), axis=1))
    assert len(inline_svg(figure, "windows")) < 60_000


def test_the_command_prints_one_document_and_draws_the_same_page(bag, result, text, tmp_path, monkeypatch):
    page = tmp_path / "out.html"
    monkeypatch.setenv("SOURCE_DATE_EPOCH", MADE)
    done = run(bag, "--json", "--html", page)
    assert done.exit_code == 0, done.exception
    assert ComparisonResult.model_validate_json(done.stdout).points == result.points
    assert page.read_text(encoding="utf-8") == text  # drawn anew: equal results give equal pages
    assert "test point 'belt' not compared" in done.stderr


def test_the_command_prints_the_table(bag, result):
    done = run(bag)
    assert done.exit_code == 0, done.exception
    head = result.points["cutterhead"]["x"]
    row = next(line for line in done.stdout.splitlines() if "cutterhead" in line)
    assert f"{head.model_rms_g:.3f}" in row
    assert f"{head.field_rms_g:.3f}" in row
    assert f"{head.relative_error:.0%}" in row
    assert "0 lost" in done.stdout
    drives = result.drives
    assert f"measured: 9 drives run, sharing factor {drives.field.sharing_factor:.3f}" in done.stdout
    assert "/tbm/field/drives: 60 samples at a level, 10 Hz, filter not stated" in done.stdout


def test_windows_and_bands_of_the_command(bag):
    chosen = "--window", "1.5", "--bands", "1-5,60-90", "--high-hz", "500"
    document = json.loads(run(bag, "--json", *chosen).stdout)
    assert document["points"]["shield"]["z"]["windows"]["start"] == [0.0, 1.5, 3.0, 4.5]
    assert list(document["points"]["shield"]["z"]["model_band_rms"]) == ["1-5_hz", "60-90_hz"]
    assert document["bands"]["shield"]["high_hz"] == 500.0


@pytest.mark.parametrize(
    ("arguments", "kind", "message"),
    [
        (["nowhere.mcap"], RecordingError, "nowhere.mcap: no such file or folder"),
        (["{bag}", "--machine", "dz999"], MachineError, "dz999"),
        (["{bag}", "--bands", "5-1200"], InputError, "band '5-1200', allowed: LOW-HIGH in Hz from 0.5 to 1000"),
        (["{bag}", "--high-hz", "801"], RecordingError, "band up to 801 Hz, allowed: up to 800, 0.4 of the sampling"),
        (["{bag}", "--high-hz", "4001"], InputError, "band 4001 Hz, allowed: 10 to 4000, 0.4 of the model's"),
        (["{bag}", "--mapping", "no.yaml"], RecordingError, "no.yaml"),
        (["{bag}", "--window", "0"], ValueError, "window 0 s"),
        (["{bag}", "--html", "no/such/folder/out.html"], ValueError, "no folder no/such/folder"),
    ],
)
def test_errors_leave_stdout_empty(bag, tmp_path, monkeypatch, arguments, kind, message):
    monkeypatch.chdir(tmp_path)
    done = run(*(argument.replace("{bag}", str(bag)) for argument in arguments), "--json")
    assert isinstance(done.exception, kind)
    assert message in str(done.exception)
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []
