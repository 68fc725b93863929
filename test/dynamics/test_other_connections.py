"""Connections whose directions are coupled or whose damping is stated.

Sources: a cantilever's tip under a force, PL³/3EI and PL²/2EI (any textbook); a rod at 45 degrees; the free decay of a
mass on a spring and a dashpot, c/(2 √(k m)).
"""

import numpy as np
import pytest
from machine_files import built, small
from pydantic import ValidationError

from tbm_dynamics.structure.assembler import Assembler
from tbm_msgs_py.base.errors import MachineError

BENDING, LENGTH, STIFF = 2.0e9, 3.0, 1e12
SIX = [1e9, 1e9, 1e9, 1e9, 1e9, 1e9]


def of(name, changes, data=None):
    """The small machine whose connection has other values; those that are None are left out."""
    data = small() if data is None else data
    groups = (data["cutterhead_bearing_gear"], data["carrier_girder"], data)
    for entry in (one for group in groups for one in group["connections"] if one["name"] == name):
        entry.update(changes)
        for key in [key for key, value in changes.items() if value is None]:
            del entry[key]
    return data


def to_the_ground(**springs):
    """Matrices (6, 6) of one node on a connection."""
    connection = built(of("k_r_ct", {"stiffness": None, **springs})).base.cutterhead_bearing_gear.connections[0]
    alone = Assembler(built(small()).base, {1: np.zeros(3)})
    alone.add_connection(1, "ground", connection)
    return alone.K, alone.C


def test_coupled_directions_bend_as_a_cantilever():
    side, turn, both = 12 * BENDING / LENGTH**3, 4 * BENDING / LENGTH, 6 * BENDING / LENGTH**2
    rows = np.diag([STIFF, side, STIFF, STIFF, STIFF, turn])
    rows[1, 5] = rows[5, 1] = -both
    K, C = to_the_ground(type="other", stiffness_matrix=rows.tolist())
    tip = np.linalg.solve(K, [0, 1e6, 0, 0, 0, 0])
    assert tip[[1, 5]] == pytest.approx([1e6 * LENGTH**3 / (3 * BENDING), 1e6 * LENGTH**2 / (2 * BENDING)])
    assert not C.any()  # other: none but what is stated


def test_a_rod_across_and_its_damper():
    rod = np.zeros((6, 6))
    rod[:2, :2] = 0.5
    K, C = to_the_ground(type="rock", stiffness=SIX, stiffness_matrix=(4e8 * rod).tolist(), damping_matrix=rod.tolist())
    along, across = np.array([[1, 1, 0, 0, 0, 0], [1, -1, 0, 0, 0, 0]]) / np.sqrt(2)
    assert [along @ K @ along, across @ K @ across] == pytest.approx([1.4e9, 1e9])
    assert [along @ C @ along, across @ C @ across] == pytest.approx([1.0, 0.0])  # in the place of that of the rock


def test_stated_damping_damps_and_that_of_the_type_does_not():
    mass, stiffness, dashpot = 2e3, 8e6, 5e4
    K, C = to_the_ground(type="hydraulic", stiffness=[stiffness] * 6, damping=[dashpot, 0, 0, 0, 0, 0])
    free = np.block([[np.zeros((6, 6)), np.eye(6)], [-K / mass, -C / mass]])
    roots = np.linalg.eigvals(free)
    ratios = -roots.real / np.abs(roots)
    assert ratios.max() == pytest.approx(dashpot / (2 * np.sqrt(stiffness * mass)))
    assert np.sum(ratios > 1e-9) == 2  # one motion: the others have no damping at all
    typed = to_the_ground(type="hydraulic", stiffness=[stiffness] * 6)[1]
    assert typed[0, 0] == built(small()).base.connection_damping.hydraulic * stiffness


def test_a_damper_alone_stands_beside_springs_and_holds_nothing():
    data = small()
    damper = {"name": "damper", "between": [12, "ground"], "type": "other", "source": "test"}
    data["connections"].append({**damper, "damping": [1e6, 0, 0, 0, 0, 0]})
    plain, damped = built(small()).assemble(), built(data).assemble()
    place = damped.dof(12, "ux")
    assert np.array_equal(plain.K, damped.K)
    assert (damped.C - plain.C)[place, place] == pytest.approx(1e6)
    assert np.count_nonzero(damped.C - plain.C) == 1
    with pytest.raises(MachineError, match=r"zero-energy mode.*12"):
        built(of("k_r_gd", {"stiffness": None, "damping": [1e6] * 6, "type": "other"})).assemble()


def test_a_multiplier_takes_coupled_stiffness_too():
    rows = np.diag([1e9, 2e9, 2e9, 1e9, 1e9, 1e9])
    rows[1, 5] = rows[5, 1] = 5e8
    machine = built(of("k_r_ct", {"stiffness": None, "stiffness_matrix": rows.tolist()}))
    changed = machine.with_inputs(x16=2.0).description.cutterhead_bearing_gear.connections[0]
    assert np.array_equal(changed.stiffness_rows, 2.0 * rows)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stiffness": None}, "no stiffness and no damping"),
        ({"stiffness": [0] * 6}, "no stiffness and no damping"),
        ({"type": "rubber"}, "'other'"),
        ({"damping": [1, 2]}, "damping"),
        ({"damping": [-1, 0, 0, 0, 0, 0]}, "greater than or equal to 0"),
        ({"stiffness_matrix": [[1, 0, 0, 0, 0, 0]]}, "stiffness_matrix"),
        ({"stiffness_matrix": np.tri(6).tolist()}, "must be symmetric"),
        ({"stiffness_matrix": (np.eye(6) - 1.0).tolist()}, "must not be negative"),
        ({"damping_matrix": np.diag([1e6, 1, 1, 1, 1, -1e-3]).tolist()}, "must not be negative"),
        ({"damping_matrix": [[np.inf] * 6] * 6}, "finite"),
    ],
)
def test_connections_that_cannot_be_are_refused(changes, message):
    with pytest.raises(ValidationError, match=message):
        built(of("k_r_ct", changes))


def test_a_drive_must_turn_in_its_bearings_whatever_is_coupled():
    data = small()
    rows = np.zeros((6, 6))
    rows[3, 3] = 1.0
    data["driveshaft"]["pinion_bearing"]["stiffness_matrix"] = rows.tolist()
    with pytest.raises(ValidationError, match="pinion_bearing: the stiffness about x must be 0"):
        built(data)
