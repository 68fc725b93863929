"""Machine files and the 25 inputs: what is refused, in one line, and what a variant changes.

Source: what docs/howto/machine.md says of a file, and the units of the paper's Table 4; every expected number is
arithmetic on the file as PyYAML reads it, so equality is exact up to one rounding of the unit's factor.
"""

import pickle
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_files import TEXT, all_connections, built, plain, without

from tbm_dynamics import MachineError, load_machine, shipped_machines
from tbm_dynamics.machine.inputs import DRIVE_INPUTS, INPUT_CODES, LOAD_INPUTS
from tbm_msgs_py.base.fields import SOURCES


def refused(path, text):
    """The message about a file; one line that starts with its name."""
    path.write_text(text)
    with pytest.raises(MachineError) as caught:
        load_machine(path).assemble()
    message = str(caught.value)
    assert "\n" not in message
    return message


ROCK = "stiffness: [1e9, 1e9, 1e9, 1e9, 1e9, 1e9]"
WRONG = {
    "negative stiffness": (
        ROCK,
        ROCK.replace("[1e9", "[-1e9"),
        "connections.0.stiffness.0",
        "greater than or equal to 0",
    ),
    "stiffness not a number": (ROCK, ROCK.replace("[1e9", "[.nan"), "connections.0.stiffness.0", "finite"),
    "five stiffnesses": (ROCK, ROCK.replace("[1e9, ", "["), "connections.0.stiffness.5", "missing"),
    "unknown node": ("between: [4, 5]", "between: [4, 99]", "k_c_cf.between: unknown node 99", "known are 1–70"),
    "both ends alike": ("between: [4, 5]", "between: [4, 4]", "connections.1: between [4, 4]", "must be two nodes"),
    "misspelt key": ("thrust_kn:", "thurst_kn:", "operating_point.thurst_kn", "allowed: speed_r_min, torque_kn_m"),
    "misspelt key in a list": (
        "outer_diameter: 5.8",
        "outer_diametre: 5.8",
        "shafts.0.outer_diametre",
        "inner_diameter",
    ),
    "misspelt key of a load": ("scales_with: thrust", "scale_with: thrust", "loads.fx.scale_with", "scales_with"),
    "misspelt key of a line": ("amplitude: 1.5e+5", "amplitud: 1.5e+5", "loads.fx.lines.0.amplitud", "amplitude"),
    "misspelt section": ("carrier_girder:", "carier_girder:", "carier_girder", "carrier_girder"),
    "key twice": ("load_node: 1", "load_node: 1\nload_node: 3", "key 'load_node' is given twice", "line"),
    "node twice in a group": ("    2: [-0.6", "    1: [-0.6", "key 1 is given twice", "line"),
    "node in two groups": ("    43: [-2.5", "    3: [-2.5", "nodes [3] are defined twice", "used once"),
    "drives on used nodes": ("nodes_from: 13", "nodes_from: 12", "nodes [12] are defined twice", "used once"),
    "shaft without wall": (
        "outer_diameter: 5.8",
        "outer_diameter: 5.0",
        "shafts.0",
        "smaller than",
    ),
    "pinion shaft without wall": (
        "pinion_shaft: {outer_diameter: 0.30,",
        "pinion_shaft: {outer_diameter: 0.30, inner_diameter: 0.3,",
        "driveshaft: pinion_shaft: inner",
        "smaller than",
    ),
    "pinion as big as the ring": ("pinion_teeth: 16", "pinion_teeth: 152", "gear: pinion_teeth 152", "fewer than"),
    "place not a number": ("    1: [0.0,", "    1: [.nan,", "cutterhead_bearing_gear.nodes.1.0", "finite"),
    "endless place": ("rotor: -4.5", "rotor: -.inf", "driveshaft.placement.rotor", "finite"),
    "angle not a number": ("first_angle_deg: 0.0", "first_angle_deg: .nan", "first_angle_deg", "finite"),
    "drive that cannot turn": (
        "{type: bearing, stiffness: [1e10, 1e9, 1e9, 0,",
        "{type: bearing, stiffness: [1e10, 1e9, 1e9, 1,",
        "pinion_bearing",
        "be 0",
    ),
    "loads without thrust": ("mean: -1.20e+7", "mean: 0.0", "loads.fx.mean", "not be 0"),
    "loads without torque": ("mean: -3.04e+6", "mean: 0.0", "loads.mx.mean", "not be 0"),
    "ring of nothing": ("ring_shaft_nodes: [7, 8, 9]", "ring_shaft_nodes: []", "ring_shaft_nodes", "at least 1"),
    "source of nothing": ("source: table5", 'source: ""', "connections.0.source", "at least 1 character"),
    "source of two lines": ("source: table5", 'source: "a\\nb"', "connections.0.source", "one line of printable"),
    "source of a load": ("1.5e+5, source: assumed", '1.5e+5, source: "a\\nb"', "loads.fx.lines.0.source", "one line"),
    "value without source": (
        "rotor: {mass: 1100, inertia: [3, 60, 60], source: assumed}",
        "rotor: {mass: 1100, inertia: [3, 60, 60]}",
        "driveshaft.rotor.source",
        "missing",
    ),
    "ring beside the axis": ("    8: [-2.5, 0.0,", "    8: [-2.5, 0.1,", "driveshaft.ring_node: node 8", "x axis"),
    "mount on a pinion": ("mount_node: 12", "mount_node: 14", "driveshaft.mount_node: node 14", "x axis"),
    "no planets": ("planets: 3", "planets: 0", "gearbox.stages.0.planets", "greater than or equal to 1"),
    "stiffness of a shaft": (
        "shaft_stiffness: 4.0e8",
        "shaft_stiffness: 0",
        "gearbox.shaft_stiffness",
        "greater than 0",
    ),
    "unknown reading": ("damping: stiffness_proportional", "damping: modal", "damping.reading", "'ratio'"),
    "ratio of no frequency": ("damping: stiffness_proportional", "damping: ratio", "damping", "frequency (Hz)"),
    "massless": ("rotor: {mass: 1100,", "rotor: {mass: 0,", "driveshaft.rotor.mass", "greater than 0"),
    "grade": ("accuracy_grade: 5", "accuracy_grade: 13", "gear.accuracy_grade", "less than or equal to 12"),
    "title that rings": ("title: ", 'title: "\\a" # ', "title", "printable"),
    "rock of no strength": ("ucs_mpa: 108", "ucs_mpa: 0", "cutters.rock.ucs_mpa", "greater than 0"),
    "strength not a number": ("bts_mpa: 7.2", "bts_mpa: .nan", "cutters.rock.bts_mpa", "finite"),
    "disc of no size": ("radius: 0.216", "radius: 0.0", "cutters.disc.radius", "greater than 0"),
    "pressure off the arc": (
        "tip_width: 0.015",
        "tip_width: 0.015, pressure_exponent: 0.5",
        "pressure_exponent",
        "0.2",
    ),
    "chips of no length": ("chip: 0.25", "chip: 0.0", "cutters.fracture.chip", "greater than 0"),
    "chips out of order": ("jitter: 0.8", "jitter: 1.0", "cutters.fracture.jitter", "0.9"),
    "teeth upside down": ("heights: [0.1, 0.6]", "heights: [0.5, 0.2]", "cutters.fracture: heights", "smaller first"),
    "teeth too high": ("heights: [0.1, 0.6]", "heights: [0.5, 1.2]", "cutters.fracture.heights.1", "equal to 1"),
    "sudden release": ("release: 0.1", "release: 0.0", "cutters.fracture.release", "0.01"),
    "misspelt key of a limit": (
        "power_kw: 3500",
        "power_kv: 3500",
        "limits.power_kv: unknown key, allowed",
        "power_kw",
    ),
    "misspelt key of a zone": (
        "side_share: 0.1",
        "face: {zones: [{level: 0.0, hardness: 1.0}], source: assumed}\n  side_share: 0.1",
        "cutters.face.zones.0.hardness: unknown key, allowed",
        "level, strength",
    ),
    "layer of negative strength": (
        "side_share: 0.1",
        "face: {zones: [{level: 0.0, strength: -1.0}], source: assumed}\n  side_share: 0.1",
        "cutters.face.zones.0.strength",
        "greater than or equal to 0",
    ),
    "boulder of no size": (
        "side_share: 0.1",
        "face: {zones: [{y: 0.0, z: 0.0, radius: 0.0, strength: 1.0}], source: assumed}\n  side_share: 0.1",
        "cutters.face.zones.0.radius",
        "greater than 0",
    ),
    "negative wear": (
        "side_share: 0.1",
        "face: {wear: {3: -0.5}, source: assumed}\n  side_share: 0.1",
        "cutters.face.wear.3",
        "greater than or equal to 0",
    ),
    **{
        f"drives: {given}": ("load_node: 1", f"load_node: 1\ndrives: {given}", where, allowed)
        for given, where, allowed in (
            ("{11: {off: true}}", "drives.11: unknown drive", "1 to 10"),
            ("{3: {backlsh: 1e-4}}", "drives.3.backlsh: unknown key", "backlash, mesh_error"),
            ("{3: {backlash: -1e-4}}", "drives.3.backlash: -0.0001", "greater than or equal to 0"),
            ("{3: {off: perhaps}}", "drives.3.off: 'perhaps'", "'dragged' or 'uncoupled'"),
            ("{3: {off: true, torque_share: 2}}", "drives.3: torque_share 2: the drive is dragged", "0, or below"),
            ("{3: {off: uncoupled, torque_share: -0.1}}", "drives.3: torque_share -0.1", "none is stated"),
            ("{3: {angle: 110}}", "drives.3.angle: 110 degrees", "drive 4 at 108, allowed: tip circles"),
            ("{3: {tooth: {fault: rust}}}", "drives.3.tooth.fault: 'rust'", "'crack', 'pitting' or 'missing'"),
            ("{3: {tooth: {fault: crack}}}", "drives.3.tooth: share", "above 0 and below 1"),
            ("{3: {tooth: {fault: crack, share: 1}}}", "drives.3.tooth.share: 1", "less than 1"),
            (f"{{{', '.join(f'{i}: {{off: true}}' for i in range(1, 11))}}}", "drives: none gives", "one that runs"),
        )
    },
    "text for a number": ("speed_r_min: 5.6", "speed_r_min: fast", "operating_point.speed_r_min", "valid number"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_file_is_refused_with_place_and_remedy(tmp_path, name):
    old, new, where, allowed = WRONG[name]
    assert old in TEXT
    path = tmp_path / "mine.yaml"
    message = refused(path, TEXT.replace(old, new, 1))
    assert message.startswith(f"{path}: ")
    assert where in message
    assert allowed in message


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ("pressure_angle_deg: 25", "pressure_angle_deg: 10.5", "driveshaft.gear: pinion of 16 teeth is undercut"),
        ("ring_teeth: 152", "ring_teeth: 17", "driveshaft.gear: "),
        ("planet_teeth: 32", "planet_teeth: 31", "driveshaft.gearbox.stages.0: "),
        ("planets: 3", "planets: 5", "driveshaft.gearbox.stages.0: "),
        ("planets: 3", "planets: 9", "driveshaft.gearbox.stages.0: "),
        ("sun_teeth: 22", "sun_teeth: 10", "driveshaft.gearbox.stages.0: "),
        ("mesh: -2.5, rear", "mesh: -2.15, rear", "two of its nodes are at the same place"),
    ],
)
def test_a_machine_that_cannot_be_built(tmp_path, old, new, where):
    path = tmp_path / "mine.yaml"
    assert old in TEXT
    message = refused(path, TEXT.replace(old, new, 1))
    assert message.startswith(f"{path}: ")
    assert where in message


def test_a_source_may_be_told_in_any_words(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(TEXT.replace("source: table5", 'source: "drawing 4711, rev. B"', 1))
    assert load_machine(path).description.all_connections()[0].source == "drawing 4711, rev. B"


def test_an_assembly_that_fails_names_the_changed_inputs(machine):
    # Hardly any stiffness: the machine floats.
    with pytest.raises(MachineError, match=r"^dz101 with x16=1e-30, x17=1e-30: .*zero-energy mode") as caught:
        machine.with_inputs(x16=1e-30, x17=1e-30).assemble()
    assert "\n" not in str(caught.value)


def test_a_machine_goes_through_a_pickle(machine):
    variant = machine.with_inputs(x16=1.5)
    again = pickle.loads(pickle.dumps(variant))
    assert again == variant
    assert again.description == variant.description
    assert again.origin == "dz101"


def test_a_machine_cannot_be_changed(machine):
    with pytest.raises(TypeError):
        machine.with_inputs(x16=1.5).inputs["x16"] = 2.0


def entries(data, path=""):
    """Every mapping of a file that holds a number, with its place."""
    if isinstance(data, dict):
        if any(isinstance(value, int | float) and not isinstance(value, bool) for value in data.values()):
            yield path, data
        for key, value in data.items():
            yield from entries(value, f"{path}.{key}")
    elif isinstance(data, list):
        for i, value in enumerate(data):
            yield from entries(value, f"{path}.{i}")


@pytest.mark.parametrize("name", shipped_machines())
def test_every_value_carries_its_source(name):
    data = plain(name)
    for key in ("load_node", "test_points", "damping", "title"):
        data.pop(key)  # names and decisions, not values
    found = dict(entries(data))
    assert len(found) > 30
    assert [place for place, entry in found.items() if "source" not in entry] == []
    assert {entry["source"] for entry in found.values()} <= set(SOURCES)  # no word misspelt


@pytest.mark.parametrize("text", ["", "- a list", "just text", "a: b: c", "name: [", "\x00", "!!python/name:os.system"])
def test_what_is_not_a_machine(tmp_path, text):
    path = tmp_path / "mine.yaml"
    assert re.match(
        f"{re.escape(str(path))}: not (YAML|a machine file, allowed: a mapping with keys of name, )",
        refused(path, text),
    )


def test_a_file_that_cannot_be_read(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    for wanted in (path, tmp_path, tmp_path / "missing.yaml", "dz102", ""):
        with pytest.raises(MachineError) as caught:
            load_machine(wanted)
        assert "\n" not in str(caught.value)
        assert str(wanted) in str(caught.value)
    assert "shipped are dz101" in str(caught.value)


def test_every_shipped_machine_can_be_built():
    assert "dz101" in shipped_machines()
    for name in shipped_machines():
        load_machine(name).assemble()


PLACES = {
    "x1": (6.2, "operating_point", "speed_r_min", 6.2),
    "x2": (1800.0, "operating_point", "torque_kn_m", 1800.0),
    "x3": (9000.0, "operating_point", "thrust_kn", 9000.0),
    "x4": (2e-3, "steel", "damping", 2e-3),
    "x5": (200.0, "steel", "elasticity", 200e9),
    "x6": (0.28, "steel", "poisson", 0.28),
    "x11": (2e-3, "connection_damping", "rock", 2e-3),
    "x12": (2e-3, "connection_damping", "bolt", 2e-3),
    "x13": (2e-3, "connection_damping", "bearing", 2e-3),
    "x14": (2e-3, "connection_damping", "spline", 2e-3),
    "x15": (2e-3, "connection_damping", "hydraulic", 2e-3),
    "x7": (250.0, "mesh", "backlash", 250e-6),
    "x8": (1.2, "mesh", "error_factor", 1.2),
    "x9": (7e9, "mesh", "mean_stiffness", 7e9),
    "x10": (0.08, "mesh", "damping_ratio", 0.08),
}
MULTIPLIED = {
    "x16": "k_r_ct",
    "x17": "k_r_gd",
    "x18": "k_c_cf",
    "x19": "k_c_fb",
    "x20": "k_c_bc",
    "x21": "k_c_cg",
    "x22": "k_b_io",
    "x25": "k_h_gd",
}


def expected_description(machine, code):
    """The file's own data with one input of Table 4 applied by hand: (value, dump)."""
    data = machine.base.model_dump()
    if code in PLACES:
        value, group, key, number = PLACES[code]
        (data["driveshaft"]["mesh"] if group == "mesh" else data[group])[key] = number
        return value, data
    if code in MULTIPLIED:
        hits = [c for c in all_connections(data) if c["name"] == MULTIPLIED[code]]
        assert len(hits) == (2 if code == "x25" else 1)
        for connection in hits:
            connection["stiffness"] = tuple(2.0 * k for k in connection["stiffness"])
    else:
        key = {"x23": "pinion_bearing", "x24": "spline"}[code]
        entry = data["driveshaft"][key]
        entry["stiffness"] = tuple(2.0 * k for k in entry["stiffness"])
    return 2.0, data


@pytest.mark.parametrize("code", [f"x{i}" for i in range(1, 26)])
def test_an_input_changes_what_it_names_and_nothing_else(machine, code):
    value, expected = expected_description(machine, code)
    before = machine.base.model_dump()
    found = machine.with_inputs(**{code: value}).description.model_dump()
    if code in PLACES:
        # One rounding of the unit's factor (µm, GPa) is allowed in the number itself.
        _, group, key, number = PLACES[code]
        place = found["driveshaft"]["mesh"] if group == "mesh" else found[group]
        assert place[key] == pytest.approx(number, rel=1e-15)
        place[key] = number
    assert found == expected
    assert machine.description.model_dump() == before
    assert tuple(INPUT_CODES) == tuple(f"x{i}" for i in range(1, 26))


@settings(max_examples=30)
@given(first=st.floats(0.5, 2.0), second=st.floats(0.5, 2.0))
def test_multipliers_are_relative_to_the_file_the_last_holds(machine, first, second):
    twice = machine.with_inputs(x16=first, x2=1500.0).with_inputs(x16=second)
    assert twice == machine.with_inputs(x16=second, x2=1500.0)
    assert twice.with_inputs(x16=second) == twice
    rock = machine.base.cutterhead_bearing_gear.connections[0]
    assert twice.description.cutterhead_bearing_gear.connections[0].stiffness == tuple(
        second * k for k in rock.stiffness
    )


def test_the_file_itself_is_the_variant_without_changes(machine):
    assert machine.with_inputs().description == machine.description
    assert machine.with_inputs(x1=5.6, x2=3040.0, x3=12000.0, x5=210.0, x16=1.0, x25=1.0).description == machine.base


def test_doubling_the_cylinders_doubles_both_of_them(machine):
    before, after = (m.assemble() for m in (machine, machine.with_inputs(x25=2.0)))
    change = after.K - before.K
    single = np.array([1e10, 5e9, 5e9, 1e10, 5e10, 5e10])
    for node in (43, 50):
        dofs = [before.dof(node, d) for d in ("ux", "uy", "uz", "rx")]
        assert np.diag(change)[dofs] == pytest.approx(single[:4])


@pytest.mark.parametrize("number", [np.float64(1.5), np.float32(1.5), np.int64(2), 2])
def test_numbers_of_numpy_are_numbers(machine, number):
    assert machine.with_inputs(x16=number).description.all_connections()[0].stiffness[0] == float(number) * 1e9


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({"x26": 1.0}, r"input 'x26': unknown; allowed are x1 … x25"),
        ({"speed": 1.0}, r"input 'speed': unknown; allowed are x1 … x25"),
        ({"x16": -1.0}, r"input x16: a stiffness multiplier must be positive, got -1.0"),
        ({"x24": 0.0}, r"input x24: a stiffness multiplier must be positive"),
        ({"x1": "fast"}, r"input x1: must be a number, got 'fast'"),
        ({"x1": None}, r"input x1: must be a number"),
        ({"x1": True}, r"input x1: must be a number"),
        ({"x1": np.array([1.0])}, r"input x1: must be a number"),
        ({"x1": 1.0 + 2.0j}, r"input x1: must be a number"),
        ({"x1": -1.0}, r"operating_point.speed_r_min: .*greater than or equal to 0"),
        ({"x2": -5.0}, r"operating_point.torque_kn_m: .*greater than or equal to 0"),
        ({"x6": 0.5}, r"steel.poisson: .*less than 0.5"),
        ({"x4": -1e-3}, r"steel.damping: .*greater than or equal to 0"),
        ({"x8": -0.1}, r"error_factor: .*greater than or equal to 0"),
        ({"loads.axial": 1.0}, r"input 'loads.axial': unknown; allowed are x1 … x25 and loads.axial_low"),
        (
            {"drive_3.backlsh": 1.0},
            r"input 'drive_3.backlsh': unknown; .* and of drive N drive_N.angle, drive_N.backlash",
        ),
        ({"drive_03.backlash": 1.0}, r"input 'drive_03.backlash': unknown"),
        ({"drive_11.backlash": 1.0}, r"drives.11: unknown drive, allowed: 1 to 10"),
        ({"drive_3.misalignment": 1.0}, r"drives.3.misalignment: 1.0, allowed: less than 1"),
        ({"x7": 3e5}, r"driveshaft.mesh.backlash: 0.3 m, allowed: less than the base pitch, 0.0626 m"),
        ({"drive_3.backlash": 4.5e8}, r"drives.3.backlash: 450 m, allowed: less than the base pitch"),
        ({"drive_3.eccentricity": 3e4}, r"drives.3.eccentricity: 0.03 m, allowed: less than the module, 0.022 m"),
        ({"loads.lateral": -1.0}, r"loads.factors.lateral: .*greater than or equal to 0"),
    ],
)
def test_a_wrong_input_is_refused(machine, inputs, message):
    with pytest.raises(MachineError, match=message) as caught:
        machine.with_inputs(**inputs)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("code", [*INPUT_CODES, *LOAD_INPUTS, *(f"drive_3.{key}" for key in DRIVE_INPUTS)])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_no_input_may_be_other_than_finite(machine, code, value):
    with pytest.raises(MachineError):
        machine.with_inputs(**{code: value})


@pytest.mark.parametrize(
    ("code", "value", "expected"),
    [
        ("backlash", 450.0, 450e-6),
        ("eccentricity", 30.0, 30e-6),
        ("angle", 75.0, 75.0),
        ("torque_share", 0.5, 0.5),
    ],
)
def test_an_input_of_one_drive_keeps_the_rest_of_it(code, value, expected):
    own = {3: {"mesh_error": 2.0, "tooth": {"fault": "crack", "share": 0.3}}, 8: {"off": True}}
    before = built({**plain(), "drives": own})
    found = before.with_inputs(**{f"drive_3.{code}": value}).description.model_dump()
    assert found["drives"][3].pop(code) == pytest.approx(expected, rel=1e-15)
    kept = before.description.model_dump()
    kept["drives"][3].pop(code)
    assert found == kept
    assert "drives" not in load_machine("dz101").base.model_dump()  # the same text and digest as ever


def test_a_multiplier_of_a_connection_that_is_not_there():
    other = built(without(plain(), ("k_h_gd", 11), ("k_h_gd", 49)))
    with pytest.raises(MachineError, match="input x25: machine dz101 has no connection named k_h_gd"):
        other.with_inputs(x25=2.0)


@settings(max_examples=6)
@given(torque=st.floats(500.0, 5000.0), thrust=st.floats(3000.0, 20000.0))
def test_loads_follow_thrust_and_torque(machine, torque, thrust):
    variant = machine.with_inputs(x2=torque, x3=thrust)
    by_thrust, by_torque = thrust / 12000.0, torque / 3040.0
    factors = [by_thrust, by_torque, by_torque, by_torque, by_thrust, by_thrust]
    assert variant.load_scale() == pytest.approx(factors)
    means = [-1.2e7, 3.091e4, 3.484e4, -3.04e6, 9.77e5, 8.27e5]
    assert variant.loads().mean == pytest.approx(np.array(means) * factors)
    assert variant.assemble().mean_load == pytest.approx(np.array(means) * factors)


def test_operating_point_and_mesh_frequency(machine):
    variant = machine.with_inputs(x1=6.0)
    assert variant.operating_point.speed == pytest.approx(2.0 * np.pi / 10.0)
    assert variant.operating_point.torque == 3.04e6
    assert variant.operating_point.thrust == 1.2e7
    assert variant.mesh_frequency == pytest.approx(15.2)
    assert variant.name == "dz101"
