"""Test points off their node move as a node would that is fixed to it."""

import numpy as np
import pytest
from machine_files import built, plain, small

from tbm_dynamics import MachineError, simulate
from tbm_dynamics.machine.description import MachineDescription
from tbm_dynamics.machine.sensor_place import SensorPlace
from tbm_dynamics.machine.summary import machine_summary
from tbm_msgs_py.base.validation import validated

ARM = (0.3, 1.2, -0.7)


@pytest.fixture(scope="module")
def both():
    """A small machine with a light node 99 fixed to node 12 by the assembly's own rigid arms, and the place there."""
    data = small()
    carrier = data["carrier_girder"]
    carrier["nodes"][99] = [a + b for a, b in zip(carrier["nodes"][12], ARM, strict=True)]
    carrier["bodies"].append({"node": 99, "mass": 1e-3, "inertia": [1e-3] * 3, "source": "test"})
    stiff = {"name": "fixed", "between": [12, 99], "type": "bolt", "stiffness": [1e10] * 6, "source": "test"}
    carrier["connections"].append(stiff)
    data["test_points"] = {"cutterhead": 1, "carrier": {"node": 12, "offset": list(ARM)}}
    return built(data)


def test_a_place_moves_as_a_node_that_is_fixed_to_its_own(both):
    system, place = both.assemble(), both.description.sensor_places["carrier"]
    forces, first = np.random.default_rng(1).standard_normal((system.size, 5)), system.dof(99, "ux")
    forces[first : first + 6] = 0.0  # so that the arm does not bend
    moved = system.solve(forces)
    expected = moved[first : first + 3]
    np.testing.assert_allclose(place.rows(system) @ moved, expected, atol=1e-9 * np.abs(expected).max())


def test_a_run_accelerates_a_place_by_its_rotation_too(both):
    response = simulate(both, 0.05, seed=1)
    place = both.description.test_points["carrier"]
    motion = response.acceleration(12)
    angular = motion[:, 3:]
    expected = motion[:, :3] + [[a @ row for a in SensorPlace(node=12, offset=ARM).arm[:, 3:]] for row in angular]
    np.testing.assert_allclose(response.acceleration(place)[:, :3], expected, rtol=1e-12)
    np.testing.assert_array_equal(response.acceleration(place)[:, 3:], angular)
    np.testing.assert_array_equal(response.acceleration(place, "y"), response.acceleration(place)[:, 1])


@pytest.mark.parametrize("stated", [{"node": 47}, {"node": 47, "offset": [0, 0, 0]}])
def test_no_offset_is_the_node_alone(stated):
    data = plain()
    data["test_points"]["girder"] = stated
    assert built(data).base.model_dump_json() == built(plain()).base.model_dump_json()


def test_a_machine_says_where_its_sensors_are():
    data = plain()
    data["test_points"]["girder"] = {"node": 47, "offset": [0, 1.2, 0]}
    data["test_points"]["rail"] = 47
    summary = machine_summary(built(data))
    assert summary.test_points["girder"] == SensorPlace(node=47, offset=(0.0, 1.2, 0.0))
    (roles,) = (node.roles for node in summary.nodes if node.node == 47)
    assert {"test point girder, off by (0, 1.2, 0) m", "test point rail"} <= set(roles)


@pytest.mark.parametrize(
    ("stated", "line"),
    [
        ({"node": 4711}, r"test_points.girder: unknown node 4711"),
        ({"offset": [0, 1, 0]}, r"test_points.girder.node: missing"),
        ({"node": 47, "offset": [0, 1]}, r"test_points.girder.offset.2: missing"),
        ({"node": 47, "offset": [0, 1, float("inf")]}, r"test_points.girder.offset.2: inf, allowed: a finite number"),
        ({"node": 47, "arm": 1}, r"test_points.girder.arm: unknown key, allowed: node, offset"),
        ("head", r"test_points.girder: 'head', allowed: a valid integer"),
        (-1, r"test_points.girder: -1, allowed: greater than or equal to 1"),
    ],
)
def test_a_wrong_place_is_one_line(stated, line):
    data = plain()
    data["test_points"]["girder"] = stated
    with pytest.raises(MachineError, match=f"^m: {line}") as caught:
        validated(MachineDescription, data, "m", MachineError)
    assert "\n" not in str(caught.value)


def test_offsets_of_unknown_points_are_refused():
    with pytest.raises(MachineError, match="test point 'roof': machine dz101 has cutterhead, shield"):
        built(plain()).with_offsets({"roof": (0.0, 1.0, 0.0)})
