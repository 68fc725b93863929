"""Rigid arms and springs against the rotation of a rigid body.

Source: scipy's Rotation, a finite rotation by 1e-7 rad; it differs from u + θ × r by θ²r/2, at most 1e-13 m here.
Strain of a rigid motion is nothing but rounding.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tbm_dynamics.structure.connection import rigid_arm, spring_rows, spring_stiffness

places = st.tuples(*[st.floats(-20.0, 20.0)] * 3).map(np.array)
units = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)


@settings(max_examples=60)
@given(offset=places, translation=units, axis=units)
def test_a_point_on_a_rigid_arm(offset, translation, axis):
    small = 1e-7
    motion = small * np.concatenate([translation, axis])
    moved = small * translation + Rotation.from_rotvec(small * axis).apply(offset) - offset
    found = rigid_arm(offset) @ motion
    # offset rotated minus offset loses digits: 20 m × 1e-16 × a few
    assert found[:3] == pytest.approx(moved, abs=3e-13 + 40.0 * 5e-16)
    assert np.array_equal(found[3:], motion[3:])


def rigid_motion(place, translation, rotation):
    return np.concatenate([translation + np.cross(rotation, place), rotation])


@settings(max_examples=60)
@given(place=places, first=places, second=places, translation=units, rotation=units)
def test_a_rigid_motion_strains_no_connection(place, first, second, translation, rotation):
    rows = spring_rows(place, first, second)
    motion = np.concatenate([rigid_motion(node, translation, rotation) for node in (first, second)])
    assert rows @ motion == pytest.approx(np.zeros(6), abs=1e-13)


@settings(max_examples=40)
@given(place=places, first=places, second=places, data=st.data())
def test_energy_is_that_of_six_springs_at_the_place(place, first, second, data):
    stiffness = np.array(data.draw(st.lists(st.floats(0.0, 1e10), min_size=6, max_size=6)))
    a, b = (np.array(data.draw(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6))) for _ in range(2))
    K = spring_stiffness(spring_rows(place, first, second), stiffness)
    ends = [q[:3] + np.cross(q[3:], place - node) for q, node in ((a, first), (b, second))]
    stretch = np.concatenate([ends[0] - ends[1], a[3:] - b[3:]])
    motion = np.concatenate([a, b])
    assert motion @ K @ motion == pytest.approx(np.sum(stiffness * stretch**2), rel=1e-9, abs=1e-4)
    assert np.array_equal(K, K.T) or np.allclose(K, K.T, rtol=1e-14)


def test_a_spring_to_the_ground_holds_its_node():
    stiffness = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    place = np.array([1.0, 2.0, 3.0])
    assert np.array_equal(spring_stiffness(spring_rows(place, place, None), stiffness), np.diag(stiffness))
