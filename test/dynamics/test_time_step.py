"""The time step that a machine chooses, and the settling that its statistics leave out.

Source: runs of far shorter steps; the free motion of one damped mass, ζ ω; the rest of a long run.
"""

from dataclasses import replace

import numpy as np
import pytest
import scipy.stats
from gear_pair import MASS, NATURAL, gear_pair
from machine_files import RIG, built, plain, quiet

from tbm_dynamics import load_machine, simulate
from tbm_dynamics.integration import DEFAULT_STEP
from tbm_dynamics.integration.settling import LONGEST_S, settling_time
from tbm_dynamics.integration.simulator import Simulator
from tbm_msgs_py.base.errors import SimulationError


def _rig(stiffer=1.0, lighter=1.0):
    """The rig without fluctuating loads, with other teeth and another pinion."""
    data = quiet(plain(RIG))
    data["driveshaft"]["mesh"]["mean_stiffness"] *= stiffer
    data["driveshaft"]["pinion_shaft"]["mass"] /= lighter
    return built(data)


@pytest.mark.parametrize("name", ["dz101", "open380"])
def test_the_shipped_machines_take_the_usual_step(name):
    assert load_machine(name).step() == DEFAULT_STEP


@pytest.mark.parametrize(("stiffer", "lighter"), [(1.0, 1.0), (10.0, 1.0), (1.0, 20.0)])
def test_light_or_stiff_teeth_take_a_step_that_is_right(stiffer, lighter):
    machine = _rig(stiffer, lighter)
    step = machine.step()
    assert step < DEFAULT_STEP
    assert (1e9 * step) % 1 == 0  # streams count in whole nanoseconds
    own, fine = (simulate(machine, 0.02, time_step=one).indicators() for one in (step, step / 4.0))
    for name, value in own.items():
        assert value == pytest.approx(fine[name], rel=0.03), name


def test_a_step_that_is_asked_for_is_checked():
    machine = _rig()
    assert machine.step(1e-5) == 1e-5
    assert Simulator(machine.assemble(), (3,)).time_step == machine.step()
    with pytest.raises(SimulationError, match=r"^time_step 0\.0001 s: too coarse for the stiffest mesh vibration"):
        machine.step(1e-4)


def test_teeth_without_inertia_are_refused():
    with pytest.raises(SimulationError, match="needs a time step below 1e-07 s"):
        _rig(stiffer=1e6).step()


@pytest.mark.parametrize("ratio", [0.02, 0.2])
def test_the_settling_of_one_damped_mass(ratio):
    pair = gear_pair(ratio, 1.0)
    C = pair.C + np.diag(np.where(np.diag(pair.C) > 0.0, 0.0, 20.0 * MASS * NATURAL))  # half critical
    assert settling_time(replace(pair, C=C)) == pytest.approx(np.log(20.0) / (ratio * NATURAL), rel=1e-9)


def test_the_settling_has_a_longest():
    assert settling_time(gear_pair(1e-9, 1.0)) == LONGEST_S
    assert load_machine("dz101").settling() == LONGEST_S


def test_the_settling_is_left_out_of_a_run():
    machine = built(quiet(plain("open380")))
    whole, settled = simulate(machine, 0.05), simulate(machine, 0.03, settling=0.02)
    assert settled.time == pytest.approx(0.02 + 1e-4 * np.arange(300))
    assert np.array_equal(settled.accelerations, whole.accelerations[200:])
    assert np.array_equal(settled.mesh_force, whole.mesh_force[200:])


def test_a_lightly_damped_rig_shows_no_start():
    machine = load_machine(RIG)
    response = simulate(machine, 1.0, settling=machine.settling())
    point = machine.description.sensor_places["bed"]
    assert scipy.stats.kurtosis(response.acceleration(point)[:, :3], fisher=False).max() < 4.5
