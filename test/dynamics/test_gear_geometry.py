"""Gear pairs and planetary stages: paths of contact, and the geometry that is refused.

Sources: the line of action intersected with the tip circles by root finding; textbook limits of undercut with standard
addenda (32, 18, 12, 8 teeth at 14.5°, 20°, 25°, 30°: 2/sin²α rounded up); the teeth themselves turned through the mesh
for tips in each other's way. Tolerances are rounding; where positions of turning teeth are sampled, 1e-6 rad.
"""

import re

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_files import stage_of

from tbm_dynamics.mesh.geometry import ExternalPair, InternalPair
from tbm_dynamics.mesh.tooth import GearError

MODULE = 0.007

angles = st.floats(20.0, 28.0)


def path_on_paper(z1, z2, angle, internal):
    """Where contact starts and ends on the line of action, seen from the pitch point, m."""
    r1, r2 = MODULE * z1 / 2.0, MODULE * z2 / 2.0
    centre = np.array([-r2 if internal else r2, 0.0])
    tip = r2 - MODULE if internal else r2 + MODULE
    # The driving pinion, centre on the left, turns counter-clockwise and pushes upwards and away from itself.
    direction = np.array([np.sin(angle), np.cos(angle)])
    end = scipy.optimize.brentq(lambda s: np.linalg.norm(s * direction + [r1, 0.0]) - r1 - MODULE, 0.0, 9 * MODULE)
    start = scipy.optimize.brentq(lambda s: np.linalg.norm(s * direction - centre) - tip, -6 * MODULE, 0.0)
    return start, end


@settings(max_examples=40)
@given(z1=st.integers(18, 60), z2=st.integers(18, 120), angle=angles)
def test_path_of_an_external_pair(z1, z2, angle):
    angle = np.radians(angle)
    pair, (start, end) = ExternalPair(z1, z2, MODULE, angle), path_on_paper(z1, z2, angle, internal=False)
    pitch = np.pi * MODULE * np.cos(angle)
    assert pair.base_pitch == pytest.approx(pitch)
    assert pair.contact_ratio == pytest.approx((end - start) / pitch, rel=1e-9)
    assert pair.pitch_phase == pytest.approx(-start / pitch, rel=1e-9)
    assert pair.path_start == pytest.approx(MODULE * z1 / 2 * np.sin(angle) + start, abs=1e-12)


@settings(max_examples=40)
@given(z1=st.integers(18, 40), z2=st.integers(70, 160), angle=angles)
def test_path_of_an_internal_pair(z1, z2, angle):
    angle = np.radians(angle)
    pair, (start, end) = InternalPair(z1, z2, MODULE, angle), path_on_paper(z1, z2, angle, internal=True)
    pitch = np.pi * MODULE * np.cos(angle)
    assert pair.base_pitch == pytest.approx(pitch)
    assert pair.contact_ratio == pytest.approx((end - start) / pitch, rel=1e-9)
    assert pair.pitch_phase == pytest.approx(-start / pitch, rel=1e-9)
    assert pair.path_start == pytest.approx(MODULE * z1 / 2 * np.sin(angle) + start, abs=1e-12)


def test_radii_of_an_external_pair():
    pair = ExternalPair(20, 25, 0.004, np.radians(20.0))
    assert (pair.pinion_pitch_radius, pair.wheel_pitch_radius) == pytest.approx((0.04, 0.05))
    assert pair.centre_distance == pytest.approx(0.09)
    assert pair.pinion_base_radius == pytest.approx(0.04 * 0.93969262)
    assert pair.wheel_base_radius == pytest.approx(0.05 * 0.93969262)


@settings(max_examples=60)
@given(z1=st.integers(12, 60), z2=st.integers(12, 120), angle=st.floats(14.5, 32.0))
def test_a_pair_not_undercut_touches_above_both_base_circles(z1, z2, angle):
    # The wheel's flank is the line between the base circles less the pinion's.
    pair = ExternalPair(z1, z2, MODULE, np.radians(angle))
    line = pair.centre_distance * np.sin(pair.pressure_angle)
    if min(z1, z2) >= 2.0 / np.sin(pair.pressure_angle) ** 2:
        assert pair.path_start >= 0.0
        assert line - pair.path_start - pair.contact_ratio * pair.base_pitch >= 0.0


def refused(pair):
    with pytest.raises(GearError) as caught:
        pair.check()
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(("degrees", "least"), [(14.5, 32), (20.0, 18), (25.0, 12), (30.0, 8)])
def test_a_pinion_of_too_few_teeth_is_undercut(degrees, least):
    expected = f"of {least - 1} teeth is undercut at {degrees:g} deg: at least {least} teeth"
    angle = np.radians(degrees)
    assert refused(ExternalPair(least - 1, 40, MODULE, angle)) == f"pinion {expected}"
    assert refused(ExternalPair(40, least - 1, MODULE, angle)) == f"wheel {expected}"
    assert refused(InternalPair(least - 1, 200, MODULE, angle)) == f"pinion {expected}"


@pytest.mark.parametrize(
    ("pair", "message"),
    [
        (ExternalPair(60, 60, MODULE, np.radians(14.5)), "contact ratio 2.186: must lie between 1 and 2"),
        (InternalPair(30, 35, MODULE, np.radians(20.0)), "contact ratio 2.397: must lie between 1 and 2"),
        (
            ExternalPair(7, 30, MODULE, np.radians(35.0)),
            "pinion of 7 teeth is pointed at 35 deg: its tip would be -0.144 modules thick, must be more than 0",
        ),
        (InternalPair(30, 30, MODULE, np.radians(20.0)), "ring of 30 teeth: must have more than the pinion's 30"),
        (
            InternalPair(18, 32, MODULE, np.radians(20.0)),
            "ring of 32 teeth has its tip circle inside its base circle at 20 deg: at least 34 teeth",
        ),
        (
            InternalPair(18, 60, MODULE, np.radians(20.0)),
            "contact in a ring of 60 teeth would start below the base circle of the pinion of 18 teeth, 2.66 mm along "
            "the line of action: at least 21 pinion teeth",
        ),
        (
            InternalPair(30, 35, MODULE, np.radians(25.0)),
            "tips of pinion and ring run into each other with a tooth difference of 5: at least 6 with 30 pinion teeth",
        ),
    ],
)
def test_a_pair_that_cannot_mesh(pair, message):
    assert refused(pair) == message


def test_no_contact_ratio_where_the_ring_has_no_flank_at_its_tip():
    with pytest.raises(GearError, match="tip circle inside its base circle"):
        _ = InternalPair(18, 32, MODULE, np.radians(20.0)).contact_ratio
    # At 34 teeth the flank just reaches the tip: 2/(1 − cos 20°) = 33.16.
    assert InternalPair(18, 34, MODULE, np.radians(20.0)).contact_ratio > 0.0


@pytest.mark.parametrize("ring", [50, 60, 80])
def test_least_pinion_in_a_ring(ring):
    least = int(re.search(r"at least (\d+) pinion", refused(InternalPair(18, ring, MODULE, np.radians(20.0))))[1])
    assert InternalPair(least, ring, MODULE, np.radians(20.0)).path_start >= 0.0
    assert InternalPair(least - 1, ring, MODULE, np.radians(20.0)).path_start < 0.0


def involute(angle):
    return np.tan(angle) - angle


def overlap(z1, z2, angle):
    """Largest angle (rad) by which a corner of a pinion tooth's tip is inside a ring tooth while they turn."""
    r1, r2 = z1 / 2.0, z2 / 2.0
    tip = r1 + 1.0
    half = np.pi / (2 * z1) + involute(angle) - involute(np.arccos(r1 * np.cos(angle) / tip))
    turn = np.linspace(-np.pi, np.pi, 40_001)  # of the pinion, far beyond the path of contact
    deepest = -np.inf
    for side in (-half, half):
        corner = (r2 - r1) + tip * np.exp(1j * (turn + side))
        radius = np.abs(corner)
        reaching = radius >= r2 - 1.0
        at = np.angle(corner)[reaching] - turn[reaching] * z1 / z2
        # A gap of the ring is as wide as a tooth of an external gear of its size; one is at angle 0 of the ring.
        gap = np.pi / (2 * z2) + involute(angle) - involute(np.arccos(r2 * np.cos(angle) / radius[reaching]))
        off = np.abs((at + np.pi / z2) % (2 * np.pi / z2) - np.pi / z2)
        deepest = max(deepest, float(np.max(off - gap)))
    return deepest


@pytest.mark.parametrize("degrees", [25.0, 28.0])
@pytest.mark.parametrize("pinion", [24, 30, 45, 60])
def test_least_tooth_difference_against_turning_teeth(pinion, degrees):
    angle = np.radians(degrees)
    least = next(n for n in range(3, 20) if overlap(pinion, pinion + n, angle) < 1e-6)
    InternalPair(pinion, pinion + least, MODULE, angle).check()
    message = refused(InternalPair(pinion, pinion + least - 1, MODULE, angle))
    assert message == (
        f"tips of pinion and ring run into each other with a tooth difference of {least - 1}: "
        f"at least {least} with {pinion} pinion teeth"
    )
    assert "tips of pinion and ring" in refused(InternalPair(pinion, pinion + 1, MODULE, angle))


@pytest.mark.parametrize(
    "pair",
    [
        InternalPair(16, 152, 0.022, np.radians(25.0)),
        InternalPair(25, 70, MODULE, np.radians(20.0)),
        ExternalPair(20, 25, MODULE, np.radians(20.0)),
        ExternalPair(8, 30, MODULE, np.radians(30.0)),
    ],
)
def test_pairs_that_mesh_are_accepted(pair):
    pair.check()


@pytest.mark.parametrize(
    ("stage", "message"),
    [
        (
            stage_of(20, 25, 3, ring=72),
            "ring_teeth 72: sun_teeth + 2 planet_teeth is 70",
        ),
        (stage_of(20, 25, 1), "planets 1: at least 2, spaced equally"),
        (stage_of(20, 25, 4), "planets 4: sun_teeth + ring_teeth = 90 must be a multiple of it for equal spacing"),
        (stage_of(20, 25, 5), "planets 5: tip circles of neighbours are -3.85 mm apart, must be more than 0"),
        (stage_of(16, 25, 2), "sun-planet mesh: pinion of 16 teeth is undercut at 20 deg: at least 18 teeth"),
        (stage_of(40, 16, 2), "sun-planet mesh: wheel of 16 teeth is undercut at 20 deg: at least 18 teeth"),
        (
            stage_of(20, 20, 2),
            "planet-ring mesh: contact in a ring of 60 teeth would start below the base circle of the pinion of "
            "20 teeth, 0.262 mm along the line of action: at least 21 pinion teeth",
        ),
    ],
)
def test_a_stage_that_cannot_be_assembled(stage, message):
    assert refused(stage) == message


def test_a_stage_that_can_be_assembled():
    stage = stage_of(20, 25, 3)
    stage.check()
    assert stage.ratio == 4.5
    assert stage.centre_distance == pytest.approx(0.1575)
    assert stage.lever == pytest.approx(0.315 * np.cos(np.radians(20.0)))
