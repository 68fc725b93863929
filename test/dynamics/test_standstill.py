"""A machine that stands still: the static answer to the mean loads, and nothing that meshes.

Sources: a balance of forces and K q = f, solved by numpy.
"""

import numpy as np
import pytest
from machine_files import built, plain, static_mesh_force

from tbm_dynamics import simulate
from tbm_dynamics.loads.stepper import load_stepper
from tbm_dynamics.streaming.schedule import Schedule
from tbm_gsa.comparison.bands import machine_bands
from tbm_gsa.comparison.expected import expected_lines
from tbm_gsa.explanation.observability import SensorChoice, observability
from tbm_msgs_py.base.errors import InputError, MachineError
from tbm_msgs_py.base.operating_point import OperatingPoint


def standing(torque=800.0, name="open380"):
    data = plain(name)
    data["operating_point"].update(speed_r_min=0, torque_kn_m=torque)
    return built(data)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("torque", "method"), [(800.0, "reduced"), (0.0, "full")])
def test_nothing_moves_and_forces_are_static(torque, method):
    machine = standing(torque)
    response = simulate(machine, 0.01, method=method)
    expected = static_mesh_force(machine) if torque else 0.0
    np.testing.assert_allclose(response.mesh_force, expected, rtol=1e-9, atol=1e-6)
    assert np.abs(response.acceleration(2)).max() < 1e-9
    if torque:  # the flanks rest on each other, and the structure is linear: K q = f beyond the gap taken up
        system = machine.assemble()
        gap = system.couplings.rows.T @ (system.couplings.stiffness * system.couplings.half_gap)
        still = np.linalg.solve(system.K, system.mean_force() + gap)
        place = system.dof(2, "ux") + np.arange(6)
        np.testing.assert_allclose(response.displacement(2)[-1], still[place], rtol=1e-3, atol=1e-7)
    assert all(np.isfinite(list(response.indicators().values())))


def test_no_line_and_no_band_is_expected():
    machine = standing()
    assert {line.kind for line in expected_lines(machine)} == {"axial"}
    assert machine_bands([machine], 1000.0) == ()
    with pytest.raises(InputError, match="nothing fluctuates at its operating point"):
        observability(machine, [SensorChoice("girder")])


def test_loads_begin_to_fluctuate_as_the_head_begins_to_turn():
    machine = built(plain("open380"))
    loads, still = load_stepper(machine, seed=3), OperatingPoint(0.0, 8e5, 5e6)
    turning, time = OperatingPoint(0.9, 8e5, 5e6), np.arange(1000) * 1e-4
    mean, full = machine.description.loads.mean, loads.evaluate(turning, turning, time, 0.0 * time)
    np.testing.assert_array_equal(loads.evaluate(still, still, time, 0.0 * time), np.tile(mean, (1000, 1)))
    started = loads.evaluate(still, turning, time, 0.0 * time)
    np.testing.assert_allclose(started - mean, (full - mean) * np.arange(1, 1001)[:, None] / 1000, atol=1e-6)
    run = simulate(machine, 0.15, schedule=Schedule([0.0, 0.1, 0.15], [0, 0, 0.9], [8e5] * 3, [5e6] * 3))
    assert np.ptp(run.mesh_force[:900]) < 1e-3 < np.ptp(run.mesh_force[1100:])


def test_discs_need_a_head_that_turns():
    with pytest.raises(MachineError, match="speed 0 rad/s, must be a number above 0"):
        standing(3000.0, "dz101").cutter_loads()
