"""What the shipped machine states beyond a bare one: motors that hold the speed, thrust from behind, rock that brakes.

Sources: the file read by PyYAML alone, rigid-body kinematics, balances of forces and moments by hand, springs in
series, and scipy's step response of one mass on a spring and a damper. Statics to 1e-6, what the conditioning of K
leaves.
"""

import copy

import numpy as np
import pytest
import scipy.signal
from machine_files import all_connections, brake, built, plain, rock, small, static_mesh_force
from reference_motion import reference_motion, start_of
from test_simulation import swinging

from tbm_dynamics import MachineError, Simulator
from tbm_dynamics.structure.assembly import node_positions
from tbm_dynamics.structure.system import DIRECTIONS
from tbm_msgs_py.base.operating_point import OperatingPoint

THRUST, TORQUE, SPEED = 1.2e7, 3.04e6, 5.6 * 2.0 * np.pi / 60.0


@pytest.fixture(scope="module")
def data():
    """As shipped, with motors that hold their angle, too."""
    data = plain()
    data["driveshaft"]["motor"]["stiffness"] = 4e5
    return data


@pytest.fixture(scope="module")
def system(data):
    return built(data).assemble()


@pytest.fixture(scope="module")
def still(system):
    """Static displacement of a node in a direction."""
    q = system.equilibrium().displacement
    return lambda node, direction: q[system.dof(node, direction)]


def gearbox_ratio(data):
    return np.prod(
        [1.0 + stage["ring_teeth"] / stage["sun_teeth"] for stage in data["driveshaft"]["gearbox"]["stages"]]
    )


def test_a_rigid_turn_strains_and_damps_the_rock_alone(system, data):
    places, turn = node_positions(built(data).description), np.zeros(system.size)
    for node in system.nodes:
        parts = [*np.cross([1.0, 0.0, 0.0], places[node]), 1.0, 0.0, 0.0]
        turn[[system.dof(node, direction) for direction in DIRECTIONS]] = parts
    for node in range(52, 71, 2):
        turn[system.dof(node, "rx")] = 1.0 / gearbox_ratio(data)  # at the motor it turns as much as all else
    held = {node: connection["stiffness"][3] for node, connection in rock(data).items()}
    damped = {1: brake(data), 50: data["connection_damping"]["rock"] * held[50]}
    for matrix, expected in ((system.K, held), (system.C, damped)):
        force = matrix @ turn
        for node, value in expected.items():
            assert force[system.dof(node, "rx")] == pytest.approx(value, rel=1e-3)
            force[system.dof(node, "rx")] = 0.0
        assert np.abs(force).max() < 1e-11 * np.abs(matrix).max()


@pytest.mark.parametrize(("key", "value"), [("C", 2.5e5), ("K", 4e5)])
def test_motors_with_power_hold_rotors_against_the_mount(data, key, value):
    # Power of the dampers and energy of the springs at any motion, with a motor that is off.
    free, ratio = copy.deepcopy(data), gearbox_ratio(data)
    del free["driveshaft"]["motor"]
    held, without = (built({**one, "drives": {4: {"off": True}}}).assemble() for one in (data, free))
    motion = np.random.default_rng(1).standard_normal(held.size)
    taken = motion @ (getattr(held, key) - getattr(without, key)) @ motion
    rotors = [motion[held.dof(50 + 2 * drive, "rx")] for drive in range(1, 11) if drive != 4]
    slip = np.array(rotors) - motion[held.dof(12, "rx")] / ratio
    assert taken == pytest.approx(value * np.sum(slip**2), rel=1e-4)  # the rest of a difference of 1e11
    assert held.drives.odd == without.drives.odd == (3,)  # which rests on its coast flank


def test_a_push_turns_a_held_machine_as_one_mass():
    # The head on its motors and a little rock: J θ̈ + c θ̇ + k θ = ΔM, everything at the head by the ratio of the teeth.
    data = small()
    drive, push = data["driveshaft"], 1e5
    drive["gearbox"]["stages"] = []
    drive["rotor"]["inertia"] = [2000.0, 60.0, 60.0]
    drive["mesh"].update(variation=0.0, error_factor=0.0)
    drive["motor"] = {"control": "speed", "damping": 1e4, "stiffness": 1e4}
    data["cutterhead_bearing_gear"]["connections"][0]["stiffness"][3] = 5e5
    system = built(data).assemble()
    loads = np.tile(system.mean_load + push * np.eye(6)[3], (10_000, 1))
    angle = Simulator(system, (1,), 2e-4).step(loads).displacement[:, 0, 3]
    gear = (152 / 16) ** 2 * drive["count"]
    tube = data["cutterhead_bearing_gear"]["shafts"][0]
    head = tube["mass"] / 8 * (tube["outer_diameter"] ** 2 + tube["inner_diameter"] ** 2)
    each = 2000.0 + drive["gearbox_output"]["inertia"][0] + drive["pinion_shaft"]["mass"] / 8 * 0.30**2
    damping = gear * 1e4 + data["connection_damping"]["rock"] * 5e5
    one_mass = scipy.signal.lti([push], [head + gear * each, damping, gear * 1e4 + 5e5])
    _, expected = scipy.signal.step(one_mass, T=np.arange(10_000) * 2e-4)
    assert expected[-1] > 0.5 * push / (gear * 1e4 + 5e5)
    # What the teeth, shafts and bearings give way.
    assert np.abs(angle - angle[0] - expected).max() < 3e-3 * expected.max()


def test_thrust_runs_from_the_cylinders_through_the_rock(system, data, still):
    stiffness = {node: np.array(connection["stiffness"]) for node, connection in rock(data).items()}
    assert stiffness[1][0] * still(1, "ux") == pytest.approx(THRUST, rel=1e-6)
    assert stiffness[50][0] * still(50, "ux") == pytest.approx(-THRUST, rel=1e-6)
    # Everything between the head's front and the cylinders carries it: shafts, and springs in series.
    shafts = [*data["cutterhead_bearing_gear"]["shafts"], *data["carrier_girder"]["shafts"]]
    areas = [np.pi / 4.0 * (shaft["outer_diameter"] ** 2 - shaft["inner_diameter"] ** 2) for shaft in shafts]
    springs = {tuple(c["between"]): c["stiffness"][0] for c in all_connections(data)}
    front = 1.8 / areas[0] + 0.4 / areas[1] + 0.3 / areas[2]
    ring = front / 210e9 + 1.0 / springs[4, 5] + 1.0 / springs[6, 7]
    assert still(8, "ux") == pytest.approx(THRUST * (1.0 / stiffness[1][0] + ring), rel=1e-6)
    rear = (0.3 / areas[2] + 0.8 / areas[3] + 12.0 / areas[4]) / 210e9
    rear += sum(1.0 / springs[pair] for pair in ((9, 10), (10, 11), (12, 44)))
    assert still(49, "ux") - still(8, "ux") == pytest.approx(THRUST * rear, rel=1e-6)


def test_statics_do_not_feel_the_oil_that_modes_feel(system, data):
    soft = copy.deepcopy(data)
    (cylinders,) = [c for c in all_connections(soft) if c.get("force_controlled")]
    assert cylinders["between"] == [49, 50]
    cylinders["stiffness"][0] *= 0.2
    other = built(soft).assemble()
    whole, same = (one.equilibrium() for one in (system, other))
    assert same.displacement == pytest.approx(whole.displacement, rel=1e-6, abs=1e-9)
    assert same.force == pytest.approx(whole.force, rel=1e-6)
    found, expected = (one.natural_frequencies(60) for one in (other, system))
    assert np.abs(found / expected - 1.0).max() > 0.02


def test_a_controller_holds_nothing_that_floats(data):
    free = copy.deepcopy(data)
    rock(free)[1]["stiffness"][0] = 0.0  # the cylinders would push the machine ahead
    with pytest.raises(MachineError, match=r"^dz101: 1 zero-energy mode\(s\): nodes 1, 2, .*, 49, .* float"):
        built(free).assemble()


def test_motors_turn_the_head_against_the_brake_of_the_rock(system, data, still):
    machine = built(data)
    moment = brake(data) * SPEED
    assert 0.02 < moment / TORQUE < 0.04
    share = static_mesh_force(machine) * (1.0 + moment / TORQUE)
    assert system.equilibrium().force[:10] == pytest.approx(np.full(10, share), rel=1e-6)
    held = {node: connection["stiffness"][3] for node, connection in rock(data).items()}
    assert abs(held[1] * still(1, "rx")) < 1e-6 * TORQUE  # its spring has nothing to do
    assert held[50] * still(50, "rx") == pytest.approx(-(TORQUE + moment), rel=1e-6)
    standing = system.under(OperatingPoint(0.0, TORQUE, THRUST), system.mean_load).equilibrium()
    assert standing.force[:10] == pytest.approx(np.full(10, static_mesh_force(machine)), rel=1e-6)


def test_a_slower_head_is_braked_less_in_a_run():
    # Without error and variation the teeth carry what the motors give once everything has come to rest again.
    data = small()
    data["driveshaft"]["mesh"].update(variation=0.0, error_factor=0.0)
    data["driveshaft"]["gearbox"]["stages"] = []
    data["driveshaft"]["rotor"]["inertia"] = [2000.0, 60.0, 60.0]
    data["cutterhead_bearing_gear"]["connections"][0]["turning_inertia"] = 8e5
    data["connection_damping"]["rock"] = 0.5
    system = built(data).assemble()
    run, loads = Simulator(system, (1,)), np.tile(system.mean_load, (8000, 1))
    before = run.step(loads[:10]).mesh_force[-1]
    run.set_operating_point(OperatingPoint(0.25 * SPEED, TORQUE, THRUST), over=1000)
    after = run.step(loads).mesh_force[-1]
    moment, share = brake(data) * SPEED, static_mesh_force(built(data))
    assert before == pytest.approx(np.full(2, share * (1.0 + moment / TORQUE)), rel=1e-6)
    assert after == pytest.approx(np.full(2, share * (1.0 + 0.25 * moment / TORQUE)), rel=1e-4)


@pytest.fixture(scope="module")
def running():
    """The small machine with everything that the shipped one states: system, loads (n, 6), and what Radau finds."""
    data = small()
    data["driveshaft"]["motor"] = {"control": "speed", "damping": 2.5e5, "stiffness": 4e5}
    rock(data)[1]["turning_inertia"] = 8e5
    (held,) = [c for c in all_connections(data) if c["between"] == [10, 12]]
    held.update(type="hydraulic", force_controlled=True)
    system = built(data).assemble()
    loads, times = swinging(system, 0.3), np.arange(250) * 1e-4
    speed = system.operating_point.speed
    found = reference_motion(
        system, start_of(system), lambda t: loads(t)[0], times, lambda t: speed * t, tolerance=1e-7
    )
    return system, loads(times), found


@pytest.mark.parametrize("method", ["reduced", "full"])
def test_a_run_of_it_is_that_of_radau(running, method):
    system, loads, (displacement, acceleration, force) = running
    assert (system.cylinders is None, system.controlled is None, system.rock_damping > 0.0) == (False, False, True)
    chunk = Simulator(system, system.nodes, method=method).step(loads)
    assert np.abs(chunk.mesh_force - force).max() < 2e-4 * force.max()
    for found, exact in ((chunk.displacement, displacement), (chunk.acceleration, acceleration)):
        expected = exact.reshape(found.shape)
        for node in (1, 8, 12):
            places = system.nodes.index(node), slice(None)
            level = np.sqrt(np.mean(expected[:, *places] ** 2, axis=0))
            off = np.sqrt(np.mean((found - expected)[:, *places] ** 2, axis=0))
            assert np.all(off[[0, 1, 2]] < 2e-3 * level[:3].max())
            assert off[3] < 2e-3 * level[3]
