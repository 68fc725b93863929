"""A comparison says what it used, what it left out, and what it doubts: in the result, the page and on the terminal."""

import json
import os
from types import SimpleNamespace

import numpy as np
import pytest
from compare_bags import RATE, START_NS, G, model_values, noise, write_bag

from tbm_dynamics.machine.loading import machine_text
from tbm_gsa.app.cli.bag.info import info
from tbm_gsa.app.cli.compare import print_tables
from tbm_gsa.app.report.compare_page import compare_page
from tbm_gsa.comparison.change_times import change_times
from tbm_gsa.comparison.results import AxisResult, ComparisonResult, WindowColumns
from tbm_gsa.comparison.units import operating_doubts, unit_doubt
from tbm_gsa.comparison.workflow import compare_recording
from tbm_gsa.history import recording_entries
from tbm_msgs_py import ACCELERATION, OperatingPoint, open_recording
from tbm_msgs_py.bags.definitions import BLOCK_TYPE, serialised_block, serialised_operating_point
from tbm_msgs_py.bags.metadata import SYNTHETIC, is_synthetic
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.errors import InputError

SHORT = {"model_duration": 1.0}
HOUR = 3600 * 10**9
SENSOR = "{units: m/s2, gravity: removed, frame: fixed, point: "
LOW, HIGH = OperatingPoint(0.4, 2e6, 8e6), OperatingPoint(0.6, 4e6, 1.4e7)


def mapping_of(path, operating_point=None, **topics):
    lines = [f"  {topic}: {SENSOR}{point}}}" for point, topic in topics.items()]
    stated = [] if operating_point is None else [f"operating_point: {operating_point}"]
    path.write_text("\n".join(["topics:", *lines, *stated]))
    return path


def two_levels(path, stamp_ns=lambda at: at, girder_ns=0):
    """40 s of two sensors and two levels of 20 s; stamps of the operating points, and the girder's clock, as told."""
    with BagWriter(path) as writer:
        for at, level in ((0, LOW), (20, HIGH)):
            log = START_NS + at * 10**9
            data = serialised_operating_point(stamp_ns(log), level)
            writer.write("/tbm/operating_point", "sensor_msgs/msg/JointState", log, data)
        for k, block in enumerate(np.split(noise(40.0)[::20], 40)):
            for point, ahead in (("shield", 0), ("girder", girder_ns)):
                log = START_NS + k * 10**9
                offsets = np.arange(len(block)) * 20 / RATE
                topic = f"/tbm/field/{point}/block"
                writer.write_block(topic, log + ahead, ACCELERATION, offsets, block, log_ns=log)
    return path


@pytest.fixture(scope="module")
def fitting(tmp_path_factory):
    return compare_recording(two_levels(tmp_path_factory.mktemp("fit") / "bag"), **SHORT).result


def told(result):
    return [(dwell.begin, dwell.end, dwell.level) for dwell in result.dwells]


@pytest.mark.parametrize(
    ("stamp_ns", "girder_ns"),
    [(lambda _: 0, 0), (lambda at: at + 7 * HOUR, 0), (lambda at: at - 7 * HOUR, 0), (lambda at: at, 5 * HOUR)],
)
def test_stamps_of_another_clock_change_no_level(tmp_path, fitting, stamp_ns, girder_ns):
    result = compare_recording(two_levels(tmp_path / "bag", stamp_ns, girder_ns), **SHORT).result
    assert fitting.doubts == ()
    assert np.array(told(result)) == pytest.approx(np.array(told(fitting)), abs=1e-3)
    assert result.recording.duration == pytest.approx(fitting.recording.duration, abs=1e-3)
    for point in ("shield", "girder"):
        assert result.points[point]["x"].windows.level == fitting.points[point]["x"].windows.level
        assert result.points[point]["x"].relative_error == pytest.approx(fitting.points[point]["x"].relative_error)
    assert result.sources.operating_clock == ("header stamps" if girder_ns else "log times")
    assert result.sources.placed == (("girder",) if girder_ns else ())
    assert len(result.doubts) == 1


def test_what_a_mapping_names_is_used_or_named(tmp_path, capsys):
    """A misspelt topic of a sensor and one of the operating point, on the terminal, in the document, on the page."""
    values = {"shield": noise(2.0), "gripper": np.nan * noise(2.0)}
    path = write_bag(tmp_path / "bag", values, operating=[(0.0, HIGH)])
    dead = {"gripper": "/tbm/field/gripper/block"}  # without a sample, which once ended the page
    mapping = mapping_of(
        tmp_path / "m.yaml", "/tbm/operating", shield="/tbm/field/shield/block", girder="/girder", **dead
    )
    compared = compare_recording(path, mapping=mapping, **SHORT)
    result = compared.result
    assert result.skipped["girder"].startswith(
        "topic /girder is not in the recording, allowed: /tbm/field/gripper/block"
    )
    assert "operating point: topic /tbm/operating is not in the recording" in result.doubts[0]
    assert (result.operating_point.source, result.sources.operating_point) == ("machine", None)
    assert result.sources.mapping == str(mapping)
    print_tables(result)
    terminal = "".join(capsys.readouterr().out.split())
    page = compare_page(compared)
    for said in (str(mapping), "dz101", "header stamps"):
        assert said.replace(" ", "") in terminal
        assert said in page
    assert "operatingpoint:noneoftherecording:themachine'sown" in terminal
    assert "Operating point: topic /tbm/operating is not in the recording" in page
    assert "Test point girder was not compared: topic /girder" in page
    assert "Test point gripper was not compared: topic /tbm/field/gripper/block: no finite sample" in page


@pytest.mark.parametrize(
    ("span", "message"),
    [
        ((3.0, 3.0), "stretch from 3 to 3 s, allowed: from 0 or later to a later time"),
        ((-1.0, 3.0), "stretch from -1 to 3 s, allowed"),
        ((1.0, np.nan), "stretch from 1 to nan s, allowed"),
        ((7.0, 9.0), r"bag: lasts 5.999\d* s, allowed: a stretch that begins before, not at 7"),
        ((2.5, 3.0), "stretch from 2.5 to 3 s: no window of 2 s lies in it .*, allowed: a longer stretch, or shorter"),
        ((1.0, 3.5), "no window of 2 s lies in it"),
        ((2.0, np.inf), None),
    ],
)
def test_a_stretch_is_compared_or_refused(tmp_path, capsys, span, message):
    path = write_bag(tmp_path / "bag", {"shield": noise(6.0)}, operating=[(0.0, HIGH)])
    if message is not None:
        with pytest.raises(InputError, match=message):
            compare_recording(path, span=span, **SHORT)
        return
    compared = compare_recording(path, span=span, **SHORT)
    assert compared.result.points["shield"]["x"].windows.level == (None, 0, 0)
    print_tables(compared.result)
    assert "outside the stretch: left out" in " ".join(capsys.readouterr().out.split())
    assert "Left out, outside the stretch: 2.0 s" in compare_page(compared)
    assert len(list(recording_entries(compared.result, compared.starts_ns))) == 2 * 3  # of the third none is replaced


def test_a_sensor_that_ends_early_hides_no_change():
    rng = np.random.default_rng(0)

    def point(count):
        level = np.exp(0.05 * rng.standard_normal(count)) * np.where(np.arange(count) < 20, 1.0, 3.0)
        columns = {"start": tuple(2.0 * np.arange(count)), "level": (0,) * count, "coverage": (1.0,) * count}
        windows = WindowColumns.model_construct(field_band_rms={"band": tuple(level)}, **columns)
        axis = AxisResult.model_construct(windows=windows, field_band_rms={"band": 1.0})
        return SimpleNamespace(axes={"x": axis})

    assert change_times({"shield": point(40), "girder": point(20)}) == (40.0,)
    assert change_times({"shield": point(40), "girder": point(38), "walkway": point(0)}) == (40.0,)
    assert change_times({"walkway": point(0)}) == ()


def test_an_axis_that_is_not_measured_is_null_and_no_zero(tmp_path, capsys):
    """And of a topic of which too little is left the result says what was not used, and why."""
    thin = noise(3.0)
    thin[::1000] = np.nan
    path = write_bag(
        tmp_path / "bag", {"shield": noise(3.0), "girder": thin, "gripper": noise(3.0), "walkway": noise(3.0)}
    )
    mapping = mapping_of(
        tmp_path / "m.yaml", **{p: f"/tbm/field/{p}/block" for p in ("shield", "girder", "gripper", "walkway")}
    )
    lacking = {"shield": "[x, ~, z]", "gripper": "[~, y, z]", "walkway": "[x, ~, z], rotation: [30, 20, 10]"}
    text = mapping.read_text()
    for point, axes in lacking.items():
        text = text.replace(f"point: {point}", f"point: {point}, axes: {axes}")
    mapping.write_text(text)
    compared = compare_recording(path, mapping=mapping, **SHORT)
    result = compared.result
    assert (
        result.skipped["girder"] == "no stretch of 1 s without a gap at 2000 Hz; "
        "5994 samples in 2.999 s, 1998 Hz on average; 6 samples that are no finite numbers"
    )
    assert result.skipped["walkway"].startswith("the sensor measures none of the machine's axes by itself")
    for point, lacks in (("shield", "y"), ("gripper", "x")):
        for axis, found in result.points[point].items():
            spectrum = result.spectra[point][axis].field.density
            level = result.levels[0].points[point][axis]
            field = [
                value
                for name, value in found.model_dump().items()
                if name.startswith("field_") and name != "field_lines"
            ]
            told = [
                found.coverage,
                found.relative_error,
                level.field_rms,
                level.relative_error,
                spectrum[20],
                *field[:6],
            ]
            assert [value is None for value in told] == [axis == lacks] * len(told)
            assert (len(found.windows.start), len(found.field_lines)) == ((0, 0) if axis == lacks else (1, 5))
            assert found.model_rms > 0.0
    history = list(recording_entries(result, compared.starts_ns))
    assert {(entry.point, entry.axis) for entry in history} == {
        ("shield", "x"),
        ("shield", "z"),
        ("gripper", "y"),
        ("gripper", "z"),
    }
    print_tables(result)
    assert " – " in next(line for line in capsys.readouterr().out.splitlines() if line.startswith("gripper"))
    assert ComparisonResult.model_validate_json(result.model_dump_json()) == result


@pytest.mark.parametrize("every", [10, 1000])
def test_messages_that_are_no_use_are_lost_and_doubted(tmp_path, capsys, every):
    """Of all but each so many the stamp is no time of ROS: what is left looks whole, at another rate."""
    with BagWriter(tmp_path / "bag") as writer:
        for k, row in enumerate(noise(0.2)):
            log = START_NS + k * 10_000_000
            data = bytearray(serialised_block(ACCELERATION, log, [0.0], row[None]))
            if (k + 1) % every:
                data[8:12] = (2 * 10**9).to_bytes(4, "little")  # nanoseconds
            writer.write("/tbm/field/shield/block", BLOCK_TYPE, log, bytes(data))
        writer.write_operating_point(START_NS, OperatingPoint(0.6, 4e3, 1.4e7))
    info(tmp_path / "bag", scan=True, mapping=None, json=True)
    said, unused = json.loads(capsys.readouterr().out), 400 - 400 // every
    assert said["lost"] == unused
    if every > 400:
        assert "is no ROS time" in said["problems"]["shield"]
        return
    result = compare_recording(tmp_path / "bag", **SHORT).result
    assert result.recording.lost == unused
    doubt = result.doubts[0]  # then that of units
    assert doubt.startswith("test point shield: of 400 messages of /tbm/field/shield/block 360 messages whose stamp is")
    assert said["doubts"] == [doubt]
    assert "operating point: torque (kN·m) 4 is about 0.0013 of the machine's own 3040" in result.doubts[1]


def test_any_way_to_a_recording_gives_the_same(tmp_path, monkeypatch):
    """Relative, absolute, by a link, from inside: mapping beside it, machine file and all."""
    (tmp_path / "site").mkdir()
    bag = write_bag(tmp_path / "site" / "bag", {"shield": noise(2.0)}, custom_data=SYNTHETIC)
    mapping_of(tmp_path / "site" / "mapping.yaml", girder="/tbm/field/shield/block")
    machine = tmp_path / "machine.yaml"
    machine.write_text(machine_text("dz101"))
    (tmp_path / "link").symlink_to(bag)
    (tmp_path / "linked.mcap").symlink_to(bag / "bag.mcap")
    (tmp_path / "linked.yaml").symlink_to(machine)
    documents = []
    for folder, given, driven in (
        (tmp_path, bag, machine),
        (tmp_path, "site/bag", "machine.yaml"),
        (bag, ".", os.path.relpath(machine, bag)),
        (tmp_path, "link", "linked.yaml"),
    ):
        monkeypatch.chdir(folder)
        documents.append(compare_recording(given, driven, **SHORT).result.model_dump())
    assert list(documents[0]["points"]) == ["girder"]
    assert all(document == documents[0] for document in documents[1:])
    linked = open_recording("linked.mcap")  # once without the mark of a synthetic recording
    assert (linked.path, is_synthetic(linked.path)) == (bag / "bag.mcap", True)
    assert linked.sources == open_recording(bag / "bag.mcap").sources


def test_units_off_by_a_factor_are_said(tmp_path):
    factors = {"cutterhead": 1.0, "shield": G, "girder": 1.0 / G, "gripper": 1e3}
    values = {point: factor * model_values(seed=0)[point] for point, factor in factors.items()}
    result = compare_recording(write_bag(tmp_path / "bag", values, rate=10_000), model_duration=4.0).result
    assert [doubt.split(" on ")[0] for doubt in result.doubts] == [
        f"test point {point}: field is about {factor:.3g} times the model"
        for point, factor in factors.items()
        if factor != 1.0
    ]
    assert json.loads(result.model_dump_json())["doubts"] == list(result.doubts)


@pytest.mark.parametrize(
    ("torque", "thrust", "said"),
    [
        (
            3.04,
            12_000.0,
            ["torque 3.04 is about 0.001 of the machine's own 3040: values in kN where the message has N?"],
        ),
        (
            3040.0,
            0.008,
            ["thrust 0.008 is about 6.7e-07 of the machine's own 12000: values in MN where the message has N?"],
        ),
        (300.0, 1_000.0, []),
        (0.0, 0.0, []),
    ],
)
def test_loads_in_another_unit_are_doubted(torque, thrust, said):
    found = operating_doubts({"torque": torque, "thrust": thrust}, {"torque": 3040.0, "thrust": 12_000.0})
    assert list(found) == [f"operating point: {text}" for text in said]


def test_units_are_told_from_what_measures():
    assert unit_doubt([9.8, 0.0, np.nan], [1.0, 1.0, 1.0]).startswith("field is about 9.81 times")
    assert unit_doubt([9.8, 1.0, 9.8], [1.0, 1.0, 1.0]) == unit_doubt([3.0, 3.0, 3.0], [1.0, 1.0, 1.0]) == ""
    assert unit_doubt([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]) == unit_doubt([np.nan], [np.nan]) == ""


def test_figures_carry_enough_digits(tmp_path, capsys):
    """A rate just beside the stated one, a level of microns of g, and a hole of one sample in thousands."""
    stated, true = 25_600.0, 25_599.7
    values = 1e-4 * G * np.random.default_rng(1).standard_normal((50_000, 3))
    with BagWriter(tmp_path / "bag") as writer:
        for first in range(0, len(values), 10_000):
            stamp = START_NS + round(first / true * 1e9)
            block = np.arange(10_000) / true
            writer.write_block("/tbm/field/shield/block", stamp, ACCELERATION, block, values[first : first + 10_000])
    compared = compare_recording(tmp_path / "bag", **SHORT)
    assert compared.result.recording.points["shield"].rate_hz == pytest.approx(true, abs=0.01)
    info(tmp_path / "bag", scan=True, mapping=None, json=False)
    print_tables(compared.result)
    out = capsys.readouterr().out
    assert f"{true:.3f}" in out
    assert str(stated) not in out
    (measured,) = (row.measured_g for row in compared.result.axial_rows)
    assert f" {measured:.3g} " in out
