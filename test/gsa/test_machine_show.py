"""`tbm-monitor machine show` and `machine check` of both shipped machines: tables, documents, pictures, bad input.

Sources: the machine file read by PyYAML alone and arithmetic on it; scipy.linalg.eigh of the assembled M and K; rigid
bodies; the keys documented at `machine_summary`. Frequencies and forces are held to 1e-6: K's conditioning is 1e10.
"""

import json
import re
import signal
import sys
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import scipy.linalg
import yaml
from matplotlib.image import imread

from tbm_dynamics import load_machine
from tbm_dynamics.machine.modes import motion_parts
from tbm_gsa.app.cli.main import main
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation

TEXT = {path.name: path.read_text("utf-8") for path in (resources.files("tbm_dynamics") / "machines").iterdir()}
STRUCTURES = ("cutterhead_bearing_gear", "carrier_girder")
KEYS = "machine title origin operating_point operating_limits nodes places shafts bodies connections drives cutters "
KEYS += "test_points load_factors masses degrees_of_freedom time_step settling"
DRIVE_KEYS = "count source ring_node mount_node radius placement members parts connections gear mesh gearbox motor"
SOURCES = ("table1", "table4", "table5", "assumed", "calibrated", "updated")
NODE_NUMBERS = r"(.*_)?node|.*_nodes(_from)?|between|test_points"  # keys
NO_MACHINE = "dz102: no such machine; shipped are dz101, open380, or give the path of a YAML file"
NO_KEY = "key.yaml: operating_point.thurst_kn: unknown key, allowed: speed_r_min, "
BAD = {
    "show --machine dz102": NO_MACHINE,
    "check --machine dz102 --json": NO_MACHINE,
    "show --machine key.yaml --out new.png": NO_KEY,
    "check --machine key.yaml": NO_KEY,
    "show --machine dz101 --count 0": "Invalid value for '--count'",
    "show --machine dz101 --out new.pdf": "new.pdf: unknown kind of picture, allowed",
    "show --machine dz101 --out nowhere/new.png": "nowhere/new.png: no folder nowhere",
    "show --machine open380 --out /proc/new.svg": "/proc/new.svg: ",  # nobody can write there, root neither
}


@pytest.fixture(params=["dz101", "open380"])
def data(request):
    return yaml.safe_load(TEXT[f"{request.param}.yaml"])


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    """Run a command beside a file with a misspelt key: exit code, stdout, stderr."""
    (tmp_path / "key.yaml").write_text(TEXT["dz101.yaml"].replace("thrust_kn:", "thurst_kn:"), "utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")  # as of a pipe
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # handlers stay those of the test process

    def run(line):
        monkeypatch.setattr(sys, "argv", ["tbm-monitor", "machine", *line.split()])
        with pytest.raises(SystemExit) as end:
            main()
        return end.value.code, *capsys.readouterr()

    return run


def document(run, line):
    code, out, err = run(f"{line} --json")
    assert (code, err) == (0, "")
    return json.loads(out)  # exactly one document


def masses(data):
    drive = data["driveshaft"]
    parts = {name: data[name].get("shafts", []) + data[name].get("bodies", []) for name in STRUCTURES}
    parts["driveshaft"] = drive["count"] * [drive[name] for name in ("pinion_shaft", "gearbox_output", "rotor")]
    found = {name: sum(part["mass"] for part in entries) for name, entries in parts.items()}
    return {**found, "total": sum(found.values())}


def connections(data):
    """Every connection between nodes, and where it is; PyYAML reads 1e9 as text."""
    for where, group in (*((name, data[name]) for name in STRUCTURES), ("between subsystems", data)):
        for entry in group["connections"]:
            turning = {key: float(entry[key]) for key in ("turning_inertia",) if key in entry}
            yield {**entry, **turning, "where": where, "stiffness": [float(value) for value in entry["stiffness"]]}


def drive_nodes(data, i):
    seat, box = data["driveshaft"]["pinion_nodes_from"] + 3 * i, data["driveshaft"]["gearbox_nodes_from"] + 2 * i
    return [seat, seat + 1, seat + 2, box, box + 1]


def number_sources(value, source=None, key=None):
    """The `source` nearest around every number; numbers of nodes have none."""
    if isinstance(value, dict):
        parts = [(part, value.get("source", source), key) for key, part in value.items()]
    elif isinstance(value, list):
        parts = [(part, source, None) for part in value if key != "nodes"]  # those of a shaft
    else:
        return [source] if re.fullmatch(r"[-+.\d]+(e[-+]?\d+)?", str(value)) else []
    kept = [part for part in parts if not re.fullmatch(NODE_NUMBERS, str(part[2]))]
    return [found for part in kept for found in number_sources(*part)]


def test_tables_show_every_connection(data, command):
    code, out, err = command(f"show --machine {data['name']}")
    assert (code, err, out.count("…")) == (0, "", 0)  # nothing cropped
    rows = [line.split() for line in out.splitlines()]
    expected = [([entry["name"], "–".join(map(str, entry["between"]))], entry) for entry in connections(data)]
    expected += [([name], data["driveshaft"][name]) for name in ("pinion_bearing", "spline", "gearbox_mount")]
    for head, entry in expected:
        (row,) = (row for row in rows if row[: len(head)] == head)
        assert (row[-8], row[-1]) == (entry["type"], entry["source"])
        assert [float(cell) for cell in row[-7:-1]] == [float(value) for value in entry["stiffness"]]
    for subsystem, mass in masses(data).items():
        assert [subsystem, f"{mass / 1e3:.4g}"] in rows


def test_the_document_holds_every_section(data, command):
    found = document(command, f"show --machine {data['name']}")
    assert set(found) == {*KEYS.split(), "modes", "sources"}
    assert set(found["drives"]) == set(DRIVE_KEYS.split())
    for key, keys in (("nodes", "node subsystem place roles"), ("modes", "frequency_hz motion node shares")):
        assert all(set(entry) == set(keys.split()) for entry in found[key])
    shafts = [{"inner_diameter": 0.0, "subsystem": n, **shaft} for n in STRUCTURES for shaft in data[n]["shafts"]]
    assert all(0.0 < shaft.pop("stress") < 235e6 for shaft in found["shafts"])
    assert found["shafts"] == shafts
    bodies = [{"subsystem": name, **body} for name in STRUCTURES for body in data[name].get("bodies", [])]
    assert found["bodies"] == [{**body, "inertia": [*map(float, body["inertia"])]} for body in bodies]
    assert (found["masses"], found["connections"]) == (masses(data), list(connections(data)))
    shown = {entry["node"]: entry["place"] for entry in found["nodes"]}
    members = [drive_nodes(data, i) for i in range(data["driveshaft"]["count"])]
    assert [member["nodes"] for member in found["drives"]["members"]] == members
    assert {node: place for part in STRUCTURES for node, place in data[part]["nodes"].items()}.items() <= shown.items()


def test_sources_are_counted(data, command):
    # Every value that a file may leave out is stated, so that all there is to count stands in the file.
    data["driveshaft"]["pinion_shaft"]["inner_diameter"] = 0.0
    data["driveshaft"]["mesh"].update(variation=1.0, error_factor=1.0)
    data["steel"]["source"] = "data sheet 4711, rev. B"
    data["loads"]["fx"]["source"] = "torque meter"  # the mean
    Path("stated.yaml").write_text(yaml.safe_dump(data), "utf-8")
    expected = {name: number_sources(data).count(name) for name in SOURCES}
    expected["measured or documented"] = len(data["steel"])  # without its source, and the mean
    assert document(command, "show --machine stated.yaml")["sources"] == expected


def test_modes_are_those_of_scipy_with_shares_of_motion(data, command):
    """A rigid machine moving along the axis is all axial, about it torsional, else lateral; the shares sum to 1."""
    found = document(command, f"show --machine {data['name']} --count 25")
    system = load_machine(data["name"]).assemble()
    frequencies = np.sqrt(scipy.linalg.eigh(system.K, system.M, eigvals_only=True)[:25]) / (2.0 * np.pi)
    assert [mode["frequency_hz"] for mode in found["modes"]] == pytest.approx(frequencies, rel=1e-6)
    checked = document(command, f"check --machine {data['name']}")["natural_frequencies_hz"]
    assert checked == pytest.approx(frequencies[:10], rel=1e-6)
    for shares, motion in ((mode["shares"], mode["motion"]) for mode in found["modes"]):
        assert min(shares.values()) >= 0.0
        assert sum(shares.values()) == pytest.approx(1.0, abs=1e-12)
        assert motion == max(("axial", "lateral", "torsional"), key=shares.__getitem__)
    places = {entry["node"]: entry["place"] for entry in found["nodes"]}
    for shift, turn in np.eye(6).reshape(6, 2, 3):
        motion = np.concatenate([[*shift + np.cross(turn, places[node]), *turn] for node in system.nodes])
        alone = "axial" if shift[0] else "torsional" if turn[0] else "lateral"
        assert motion_parts(system, motion)[alone] == pytest.approx(motion, abs=1e-12)


def test_the_check_finds_size_frequency_and_mesh_force(data, command):
    name, gear, count = data["name"], data["driveshaft"]["gear"], data["driveshaft"]["count"]
    nodes = sum(len(data[part]["nodes"]) for part in STRUCTURES) + 5 * count
    base = gear["module"] * gear["ring_teeth"] / 2.0 * np.cos(np.radians(gear["pressure_angle_deg"]))
    rock = data["cutterhead_bearing_gear"]["connections"][0]
    damper = (
        2.0
        * float(data["connection_damping"]["rock"])
        * np.sqrt(float(rock["stiffness"][3]) * float(rock.get("turning_inertia", 0.0)))
    )
    braked = damper * data["operating_point"]["speed_r_min"] * np.pi / 30.0  # the head's own turning
    force = (data["operating_point"]["torque_kn_m"] * 1e3 + braked) / (count * base)
    mesh_hz = data["operating_point"]["speed_r_min"] / 60.0 * gear["ring_teeth"]
    found = document(command, f"check --machine {name}")
    assert found["sha256"] == MachineEvaluation.of(name, 1.0, 0).settings["machine_sha256"]  # as a study names it
    assert (found["nodes"], found["degrees_of_freedom"], found["meshes"]) == (nodes, 6 * nodes, count)
    found = [found["mesh_frequency_hz"], *found["static_mesh_force"]]
    assert found == pytest.approx([mesh_hz, *count * [force]], rel=1e-6)
    code, out, err = command(f"check --machine {name}")
    assert (code, err) == (0, "")
    assert out.startswith(f"{name}: {nodes} nodes, {6 * nodes} degrees of freedom, {count} meshes\n")
    assert f"mesh frequency {mesh_hz:.2f} Hz, static mesh force {force / 1e3:.1f} kN each" in out


def test_drives_that_differ_are_shown(command):
    odd = '{2: {off: true}, 3: {backlash: 450e-6, tooth: {fault: crack, share: 0.3}, source: "inspection"}}'
    Path("odd.yaml").write_text(f"{TEXT['open380.yaml']}\ndrives: {odd}\n", "utf-8")
    rows = [line.split() for line in command("show --machine odd.yaml")[1].splitlines()]
    assert ["2", "off", "dragged", "assumed"] in rows
    assert ["3", "backlash", "0.00045,", "tooth", "crack", "0.3", "inspection"] in rows
    found, alike = (document(command, f"show --machine {name}") for name in ("odd.yaml", "open380"))
    overrides = [member["override"] for member in found["drives"]["members"]]
    assert [one and one["off"] for one in overrides] == [None, "dragged", None, None]
    assert overrides[2]["tooth"] == {"fault": "crack", "share": 0.3}
    assert found["sources"]["measured or documented"] == alike["sources"]["measured or documented"] + 2
    each = np.array(document(command, "check --machine open380")["static_mesh_force"]) / 1e3
    expected = ", ".join(f"{force:.4g}" for force in each * np.array([4, 0, 4, 4]) / 3)
    out = " ".join(command("check --machine odd.yaml")[1].split())
    assert f"static mesh force {expected} kN" in out


def test_pictures(data, command):
    code, out, err = command(f"show --machine {data['name']} --out picture.png --json")
    assert (code, json.loads(out)["machine"], err) == (0, data["name"], "drawing: picture.png\n")
    assert Path("picture.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    drawn = (imread("picture.png")[:, :, :3] < 0.9).any(axis=2)
    assert np.all(drawn.shape >= np.array([700, 1200]))
    assert 0.01 < drawn.mean() < 0.3  # lines and letters on white, none of them cut at the border
    assert not any(edge.any() for edge in (drawn[0], drawn[-1], drawn[:, 0], drawn[:, -1]))
    assert command(f"show --machine {data['name']} --out picture.svg")[::2] == (0, "drawing: picture.svg\n")
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))  # letters are curves
    groups = {element.get("id"): element for element in ElementTree.parse("picture.svg", parser).iter()}
    side, end = ({(part.text or "").strip() for part in groups[axes].iter()} for axes in ("axes_1", "axes_2"))
    nodes = {*drive_nodes(data, 0), *(node for part in STRUCTURES for node in data[part]["nodes"])}
    assert set(map(str, nodes)) <= side
    assert {str(drive_nodes(data, i)[1]) for i in range(data["driveshaft"]["count"])} <= end


def test_cutters_of_the_layout_file(command):
    rows = [line.split(",") for line in TEXT["dz101_cutters.csv"].splitlines() if line[:1].isdigit()]
    found = document(command, "show --machine dz101")["cutters"]
    for kind, count in {"centre": 4, "face": 32, "gauge": 11}.items():  # the paper's
        radii = [float(row[2]) for row in rows if row[1] == kind]
        expected = {"cutters": count, "discs": len(radii), "radius": [min(radii), max(radii)]}
        assert found["types"][kind] == expected
    # formulas of the reference by hand: 160 and 24.5 kN a cutter at 9.9 mm; twins and tilt deepen it.
    assert found["normal_force_kn"] == pytest.approx(160.0, rel=0.05)
    assert found["rolling_force_kn"] == pytest.approx(24.5, rel=0.1)
    assert found["torque_kn_m"] == pytest.approx(3040.0, rel=0.05)
    assert document(command, "show --machine open380")["cutters"] is None


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_one_line(line, command):
    code, out, err = command(line)
    assert (code, out, len(err.splitlines())) == (2, "", 1), err
    assert err.startswith(f"tbm-monitor: {BAD[line]}")
    assert [path.name for path in Path.cwd().iterdir()] == ["key.yaml"]  # nothing written


def test_names_of_others_are_drawn_as_they_are(command):
    # A dollar sign is no mathematics, and a letter that no font has is no warning.
    Path("my.yaml").write_text(re.sub("title: .*", 'title: "costs $5_{ and $6 掘進機"', TEXT["open380.yaml"]), "utf-8")
    code, _, err = command("show --machine my.yaml --out my.svg")
    assert (code, err.splitlines()) == (0, ["drawing: my.svg"])
    ElementTree.parse("my.svg")
