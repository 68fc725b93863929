"""Drives that are not like the others: statics by hand, and their motion against methods that know of no split.

Sources: the balance of torques (each motor's torque at its mesh, all together that of the head); the reference method
on every unknown, and scipy's Radau. Tolerances: statics to 1e-6, what the conditioning of K leaves; motion as for alike
drives, 1e-3 of the largest mesh force and 1 % of accelerations in the mean square.
"""

import numpy as np
import pytest
from machine_files import bare, built, plain, small, static_mesh_force
from pydantic import ValidationError
from reference_motion import reference_motion, start_of
from test_simulation import swinging

from tbm_dynamics import Simulator
from tbm_msgs_py.base.operating_point import OperatingPoint

NODES = (8, 14, 17, 20)


def few(drives, count=4, motor=None):
    """A small machine of four drives, one more than patterns."""
    data = small()
    data["driveshaft"]["count"] = count
    if motor is not None:
        data["driveshaft"]["motor"] = motor
    return built({**data, "drives": drives})


def shares(drives):
    """Static mesh forces over those of equal shares."""
    machine = built({**bare(plain()), "drives": drives})
    return machine.assemble().equilibrium().force[:10] / static_mesh_force(machine)


@pytest.mark.parametrize(
    ("drives", "expected"),
    [
        ({8: {"off": True}}, {8: 0.0, None: 10 / 9}),
        ({8: {"off": "uncoupled"}, 1: {"off": True}}, {8: 0.0, 1: 0.0, None: 10 / 8}),
        ({3: {"torque_share": 1.3}}, {3: 13.0 / 10.3, None: 10.0 / 10.3}),
        ({8: {"off": True, "torque_share": -0.1}}, {8: -1.0 / 8.9, None: 10.0 / 8.9}),
        ({3: {"torque_share": 0.0, "backlash": 9e-4, "tooth_stiffness": 0.5}}, {3: 0.0, None: 10 / 9}),
        ({2: {"angle": 30.0, "mesh_error": 5.0, "tooth": {"fault": "missing"}}}, {None: 1.0}),
    ],
)
def test_running_motors_share_the_torque_by_their_weights(drives, expected):
    force = shares(drives)
    assert force == pytest.approx([expected.get(i, expected[None]) for i in range(1, 11)], abs=1e-6)
    assert force.sum() == pytest.approx(10.0, rel=1e-6)


def test_motors_scatter_as_a_master_leaves_its_slaves():
    # Of ten motors of a recorded main drive: standard deviation 1.8 % of the mean, highest 1.03, lowest 0.98 of it;
    # of a symmetric law 0.97.
    data = bare(plain())
    data["driveshaft"]["motor"] = {"scatter": 0.018}
    force = built(data).assemble().equilibrium().force[:10] / static_mesh_force(built(bare(plain())))
    assert (force.mean(), force.std()) == pytest.approx((1.0, 0.018), rel=1e-5)
    assert (force.max(), force.min()) == pytest.approx((1.03, 0.97), abs=0.005)


def test_an_idle_drive_rests_on_its_coast_flank_others_drive():
    system = few({2: {"off": True, "backlash": 4e-4}, 3: {"tooth_stiffness": 0.5}}).assemble()
    deflection = (system.couplings.rows @ system.equilibrium().displacement)[:4]
    load = 3.04e6 / (3 * 1.672 * np.cos(np.radians(25.0)))
    stiffness = 8.1e9 * np.array([1.0, np.inf, 0.5, 1.0])
    assert deflection == pytest.approx(np.array([150e-6, -200e-6, 150e-6, 150e-6]) + load / stiffness, rel=1e-6)


def test_a_drive_may_sit_on_a_mount_of_its_own():
    """Its gearbox and rotor are held as in a machine all of whose drives are."""
    data = small()
    mount = data["driveshaft"]["gearbox_mount"]
    mount["stiffness"] = [0.6 * value for value in mount["stiffness"]]
    one, none, all_ = (
        built(m).assemble() for m in ({**small(), "drives": {2: {"mount_stiffness": 0.6}}}, small(), data)
    )
    first, second = one.drives.dofs
    assert one.drives.odd in ((0,), (1,))
    np.testing.assert_allclose(one.K[np.ix_(first, first)], none.K[np.ix_(first, first)])
    np.testing.assert_allclose(one.K[np.ix_(second, second)], all_.K[np.ix_(second, second)])
    assert not np.allclose(all_.K[np.ix_(second, second)], none.K[np.ix_(second, second)])


def test_a_drive_may_be_carried_by_another_node():
    """It takes the reaction of the motor there, at the motor's speed, and every mesh its share of the torque."""
    machine = built({**small(), "drives": {2: {"mount_node": 10}}})
    system = machine.assemble()
    turns = {node: system.motor_pattern[system.dof(node, "rx")] for node in system.nodes}
    share, ratio = 16 / 152 / 2, (1 + 86 / 22) * (1 + 83 / 19)
    assert {node: pytest.approx(value) for node, value in turns.items() if value} == {
        10: -share / ratio,
        12: -share / ratio,
        52: share,
        54: share,
    }
    assert system.equilibrium().force[:2] == pytest.approx(static_mesh_force(machine))
    for node in (8, 99, 13):
        with pytest.raises(ValidationError, match=rf"drives.2.mount_node: node {node}"):
            built({**small(), "drives": {2: {"mount_node": node}}})


@pytest.mark.parametrize("torque", [0.0, 1e-9])
def test_without_torque_running_motors_hold_the_drive_flank(torque):
    machine = few({2: {"off": True}})
    system = machine.assemble()
    idle = system.under(OperatingPoint(speed=0.5, torque=torque, thrust=1e7), np.array([-1e7, 0, 0, -torque, 0, 0]))
    deflection = (system.couplings.rows @ idle.equilibrium().displacement)[:4]
    assert deflection == pytest.approx(np.array([1, -1, 1, 1]) * 150e-6, rel=1e-6)


ODD = {
    "meshes": {
        1: {"tooth_stiffness": 0.6, "backlash": 450e-6, "tooth": {"fault": "pitting", "share": 0.5}},
        3: {"eccentricity": 80e-6, "misalignment": 0.4},
        4: {"tooth_stiffness": 1.4, "mesh_error": 3.0},
    },
    "torque": {2: {"torque_share": 1.3}, 4: {"torque_share": 0.2}},
    "angles": {2: {"angle": 60.0}, 3: {"angle": 220.0, "tooth": {"fault": "crack", "share": 0.4}}},
    "uncoupled": {2: {"off": "uncoupled"}},
    "seats": {3: {"seat_stiffness": 0.5, "mount_stiffness": 0.6, "mount_node": 10}, 1: {"tooth_stiffness": 0.8}},
}
HELD = {
    "held": {1: {"tooth_stiffness": 0.6}, 2: {"torque_share": 1.3}},
    "held, one off": {1: {"tooth_stiffness": 0.6}, 4: {"off": True, "torque_share": -0.4}},
}
COMPILED = ("seats", "uncoupled", "held, one off")  # for a pattern more, in 20 s


def motion(system, method, torque_falls):
    """Chunk of 0.12 s of a swinging load; the motors' torque may fall on the way."""
    loads = swinging(system, 0.2)(np.arange(1200) * 1e-4)
    run = Simulator(system, NODES, method=method)
    if not torque_falls:
        return [run.step(loads)]
    first = run.step(loads[:400])
    point = system.operating_point
    run.set_operating_point(OperatingPoint(point.speed, 0.7 * point.torque, point.thrust), over=300)
    loads[400:, 3] *= 0.7
    return [first, run.step(loads[400:])]


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.verify if name in COMPILED else ()) for name in (*ODD, *HELD)]
)
def test_reduced_against_every_unknown(name):
    motor = {"control": "speed", "damping": 2.5e5, "stiffness": 4e5} if name in HELD else None
    system = few({**ODD, **HELD}[name], motor=motor).assemble()
    assert (system.drives.odd != ()) == (name in COMPILED)
    actual, expected = (
        [np.concatenate([getattr(c, what) for c in chunks]) for what in ("mesh_force", "acceleration")]
        for chunks in (motion(system, method, name == "torque") for method in ("reduced", "full"))
    )
    assert np.abs(actual[0] - expected[0]).max() < 2e-3 * expected[0].max()
    scale, error = (np.sqrt(np.mean(part**2, axis=0)) for part in (expected[1], actual[1] - expected[1]))
    # A pinion that nothing drives strikes both flanks: no two methods agree on its motion, only on the rest.
    driven = [i for i in range(len(NODES)) if name != "uncoupled" or NODES[i] != 17]
    assert np.all(error[driven] < (0.02 if name == "uncoupled" else 0.01) * scale[driven] + 1e-6 * scale.max(axis=0))


def test_reduced_against_radau():
    system = few(
        {1: {"tooth_stiffness": 0.6, "backlash": 450e-6}, 2: {"torque_share": 1.3, "misalignment": 0.2}}, 2
    ).assemble()
    times, loads = np.arange(250) * 1e-4, swinging(system, 0.2)
    speed = system.operating_point.speed
    exact = reference_motion(
        system, start_of(system), lambda t: loads(t)[0], times, lambda t: speed * t, tolerance=1e-6
    )
    actual = Simulator(system, system.nodes).step(loads(times)).mesh_force
    assert np.abs(actual - exact[2]).max() < 1e-3 * exact[2].max()


@pytest.mark.parametrize("external", [False, True])
def test_teeth_push_the_gears_apart_on_either_flank(external):
    # The third drive brakes: its pinion is pushed away from the teeth of the ring as those of the others are.
    data = bare(plain())
    if external:
        data["driveshaft"]["gear"]["ring"] = "external"
    system = built({**data, "drives": {3: {"torque_share": -0.9}}}).assemble()
    still, seats = system.equilibrium(), {}
    for drive in (1, 3):
        angle, force = 2.0 * np.pi * (drive - 1) / 10, still.force[drive - 1] * system.couplings.rows[drive - 1]
        at = system.dof(14 + 3 * (drive - 1), "uy")
        seats[drive] = -force[at : at + 2] @ [np.cos(angle), np.sin(angle)], still.force[drive - 1]
    assert seats[1][1] > 0.0 > seats[3][1]
    assert seats[3][0] / seats[1][0] == pytest.approx(-seats[3][1] / seats[1][1], rel=1e-9)
    assert np.sign(seats[1][0]) == (1.0 if external else -1.0)
