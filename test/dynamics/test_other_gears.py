"""Helical teeth, profile shift and rings that are driven from outside, in the file and in the assembled machine.

Sources: tables of worked examples, Stock Drive Products, Elements of Metric Gear Technology (tables 4-4, 4-8 and 5-1,
in other units of length), and D. Bolsover's copies of them with their contact ratios; a published spreadsheet of
internal gears with profile shift (17 and 96 teeth, 14 mm); ISO 21771; a machine turned and moved as a rigid body.
"""

import numpy as np
import pytest
from machine_files import built, plain
from pydantic import ValidationError

from tbm_dynamics.mesh.geometry import ExternalPair, InternalPair
from tbm_dynamics.mesh.stiffness import PATTERN_PARTS, rounded_variation
from tbm_dynamics.mesh.tooth import GearError
from tbm_dynamics.mesh.waves import series
from tbm_dynamics.structure.assembly import node_positions
from tbm_dynamics.structure.connection import rigid_arm
from tbm_msgs_py.base.errors import MachineError

A20, A30 = np.radians([20.0, 30.0])


def test_an_external_spur_pair_as_published():
    pair = ExternalPair(12, 24, 3.0, A20, 0.0, 0.6, 0.36)
    assert np.degrees(pair.working_angle) == pytest.approx(26.0886, abs=1e-4)
    assert pair.centre_distance == pytest.approx(56.4999, abs=1e-4)
    assert 2 * pair.pinion_pitch_radius == pytest.approx(37.667, abs=5e-4)
    assert (2 * pair.pinion.tip_radius, 2 * pair.wheel.tip_radius) == pytest.approx((44.840, 79.400), abs=1e-3)
    assert (2 * pair.pinion.root_radius, 2 * pair.wheel.root_radius) == pytest.approx((32.100, 66.660), abs=1e-3)
    assert pair.contact_ratio == pytest.approx(1.202, abs=1e-3)


def test_an_external_helical_pair_as_published():
    pair = ExternalPair(12, 60, 3.0, A20, A30, 0.09809, 0.0)
    assert np.degrees([pair.transverse_angle, pair.working_angle]) == pytest.approx([22.79588, 23.1126], abs=1e-4)
    assert pair.centre_distance == pytest.approx(125.0, abs=1e-4)
    assert (2 * pair.pinion_base_radius, 2 * pair.wheel_base_radius) == pytest.approx((38.322, 191.611), abs=1e-3)
    assert (2 * pair.pinion.tip_radius, 2 * pair.wheel.tip_radius) == pytest.approx((48.153, 213.842), abs=1e-3)
    path = (
        np.sqrt(48.153**2 - 38.322**2) / 2 + np.sqrt(213.842**2 - 191.611**2) / 2 - 125.0 * np.sin(pair.working_angle)
    )
    assert pair.contact_ratio == pytest.approx(
        path / (np.pi * 3.0 / np.cos(A30) * np.cos(pair.transverse_angle)), rel=1e-3
    )
    assert pair.overlap_ratio(40.0) == pytest.approx(40.0 * 0.5 / (3.0 * np.pi))


@pytest.mark.parametrize(
    ("pair", "degrees", "distance"),
    [
        (InternalPair(17, 96, 14.0, A20, 0.0, 0.2, 0.5), 21.1251, 557.0887),
        (InternalPair(16, 24, 3.0, A20, 0.0, 0.0, 0.5), 31.0937, 13.1683),
    ],
)
def test_internal_pairs_as_published(pair, degrees, distance):
    assert np.degrees(pair.working_angle) == pytest.approx(degrees, abs=1e-4)
    assert pair.centre_distance == pytest.approx(distance, abs=1e-4)
    assert pair.ring_pitch_radius - pair.pinion_pitch_radius == pytest.approx(distance, abs=1e-4)


@pytest.mark.parametrize(
    ("pair", "message"),
    [
        (ExternalPair(20, 30, 3.0, A20, 0.0, 2.0, 2.0).check, "pinion of 20 teeth is pointed|contact ratio"),
        (ExternalPair(20, 30, 3.0, A20, 0.0, -0.3, 0.0).check, "pinion of 20 teeth is undercut at 20 deg: at least 23"),
        (InternalPair(20, 60, 3.0, A20, 0.0, -0.1, 0.0).check, "at least 2[0-9] teeth|at least 2[0-9] pinion teeth"),
        (
            InternalPair(20, 32, 3.0, A20, 0.0, 0.01, 0.01).check,
            "tip circle inside its base circle at 20 deg: a larger",
        ),
        (lambda: InternalPair(20, 24, 3.0, A20, 0.0, 0.0, 2.0).working_angle, "profile shifts 0 and 2 of 20 and 24"),
    ],
)
def test_shifts_that_are_too_much_are_refused(pair, message):
    with pytest.raises(GearError, match=message) as caught:
        pair()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("overlap", [0.3, 1.0, 1.7])
def test_helical_teeth_are_spur_teeth_one_after_the_other(overlap):
    shape = np.where(np.arange(PATTERN_PARTS) < 0.6 * PATTERN_PARTS, 2.0, 1.0)
    phases = np.linspace(0.0, 1.0, 50, endpoint=False)
    slices = overlap * ((np.arange(400) + 0.5) / 400 - 0.5)

    def at(coefficients, where):
        return series(where, len(coefficients) // 2) @ coefficients

    spur, helical = rounded_variation(shape), rounded_variation(shape, overlap)
    mean = np.mean([at(spur, phases + shift) for shift in slices], axis=0)
    np.testing.assert_allclose(at(helical, phases), mean, atol=1e-4)
    if overlap == 1.0:
        assert np.abs(helical).max() < 1e-12  # lines of contact of constant length


GEARS = {
    "helical": {"helix_angle_deg": 12.0},
    "external": {"ring": "external"},
    "all": {"ring": "external", "helix_angle_deg": -15.0, "profile_shift": [0.3, -0.1]},
}


@pytest.fixture(scope="module", params=GEARS.values(), ids=GEARS)
def geared(request):
    data = plain("open380")
    data["driveshaft"]["gear"].update(request.param)
    machine = built(data)
    return machine, machine.assemble()


def test_the_teeth_carry_the_torque_and_push_along_the_axis(geared):
    machine, system = geared
    drive, point = machine.description.driveshaft, machine.operating_point
    gear, force = drive.gear, system.equilibrium().force
    module = gear.module / np.cos(np.radians(gear.helix_angle_deg))
    transverse = np.arctan(np.tan(A20) / np.cos(np.radians(gear.helix_angle_deg)))
    base = module * gear.ring_teeth / 2 * np.cos(transverse)
    assert force[:4] == pytest.approx(point.torque / 4 / base)
    assert force[4:] == pytest.approx(point.torque / 4 * gear.pinion_teeth / gear.ring_teeth)
    # On the ring: about x the torque, along x the tangential force at the reference circle times tan β.
    on_ring = -system.couplings.rows[:4, system.dof(drive.ring_node, "ux") + np.arange(6)].T @ force[:4]
    tangential = point.torque / (module * gear.ring_teeth / 2)
    expected = [tangential * np.tan(np.radians(gear.helix_angle_deg)), 0, 0, point.torque, 0, 0]
    np.testing.assert_allclose(on_ring, expected, atol=1e-6 * point.torque)


def test_nothing_is_strained_by_rigid_motion_and_turning(geared):
    machine, system = geared
    drive = machine.description.driveshaft
    rows = system.couplings.rows
    places = node_positions(machine.description)
    moved = np.vstack([rigid_arm(places[node]) for node in system.nodes])
    assert np.abs(rows[:4] @ moved).max() < 1e-12
    outside = drive.gear.ring == "external"
    turned = np.zeros(system.size)
    turned[system.dof(drive.ring_node, "rx")] = 1.0
    for node in range(21, 33):
        turned[system.dof(node, "rx")] = (-1 if outside else 1) * 125 / 19
    for node in range(41, 49):
        turned[system.dof(node, "rx")] = (-1 if outside else 1) * 125 / 19
    assert np.abs(rows @ turned).max() < 1e-12


def test_external_pinions_stand_around_the_ring(geared):
    machine, _ = geared
    gear, radius = machine.description.driveshaft.gear, machine.description.driveshaft.gear.pair.centre_distance
    assert (radius > gear.module * gear.ring_teeth / 2) == (gear.ring == "external")


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"ring": "outside"}, ValidationError, "'internal' or 'external'"),
        ({"helix_angle_deg": 60}, ValidationError, "less than 45"),
        ({"profile_shift": [0.1]}, ValidationError, "profile_shift"),
        ({"profile_shift": [2.0, -1.0]}, ValidationError, "working pressure angle must be above 0"),
        ({"profile_shift": [-0.9, 0]}, MachineError, "driveshaft.gear: pinion of 19 teeth is undercut at 20 deg"),
    ],
)
def test_gears_of_a_file_that_cannot_be(changes, error, message):
    data = plain("open380")
    data["driveshaft"]["gear"].update(changes)
    with pytest.raises(error, match=message):
        built(data).assemble()


def test_what_is_not_stated_is_not_written():
    gear = built(plain("open380")).base.driveshaft.gear
    assert not {"ring", "helix_angle_deg", "profile_shift"} & set(gear.model_dump())
    assert gear.model_copy(update={"ring": "external"}).model_dump()["ring"] == "external"
