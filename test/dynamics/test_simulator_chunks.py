"""The simulator in pieces and in trouble: the same bits in any pieces, and errors that say when.

Source: one call over the whole run; docs/model.md promises the same bits, so there is no tolerance.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_files import built, small

from tbm_dynamics import Machine, SimulationError, Simulator, simulate
from tbm_dynamics.integration import simulator
from tbm_dynamics.integration.condensed import Condensed
from tbm_dynamics.integration.lobatto import Lobatto
from tbm_dynamics.structure.system import DIRECTIONS

STEPS = 700
NODES = (3, 8, 14)


@pytest.fixture(scope="module")
def two_drives():
    return built(small()).assemble()


@pytest.fixture(scope="module")
def loads(machine):
    return machine.loads(seed=5).evaluate(np.arange(STEPS) * 1e-4)


@pytest.fixture(scope="module")
def whole(system, loads):
    return Simulator(system, NODES).step(loads)


def joined(chunks):
    assert [chunk.first_step for chunk in chunks] == list(
        np.cumsum([0, *(len(chunk.mesh_force) for chunk in chunks[:-1])])
    )
    return [
        np.concatenate([getattr(c, name) for c in chunks]) for name in ("displacement", "acceleration", "mesh_force")
    ]


def same(chunks, whole):
    parts = joined(chunks)
    return all(
        np.array_equal(part, getattr(whole, name))
        for part, name in zip(parts, ("displacement", "acceleration", "mesh_force"), strict=True)
    )


@settings(max_examples=12)
@given(cuts=st.sets(st.integers(1, STEPS - 1), max_size=12))
def test_any_pieces_give_the_same_bits(system, loads, whole, cuts):
    run = Simulator(system, NODES)
    assert same([run.step(part) for part in np.split(loads, sorted(cuts))], whole)
    assert run.next_step == STEPS


def test_one_step_at_a_time_across_a_border_of_the_output_blocks(system, loads, whole):
    run = Simulator(system, NODES)
    pieces = [loads[:1], loads[1:250], *(loads[i : i + 1] for i in range(250, 262)), loads[262:]]
    assert same([run.step(piece) for piece in pieces], whole)


@pytest.mark.parametrize(("name", "home"), [("reduced", Condensed), ("full", Lobatto)])
def test_two_runs_in_turn_share_one_method(system, two_drives, loads, monkeypatch, name, home):
    # On every unknown the small machine, whose constants take a hundredth of the time.
    system, nodes = (two_drives, (8, 14)) if name == "full" else (system, NODES)
    expected = Simulator(system, nodes, method=name).step(loads[:40])
    method = home(system, np.array([system.dof(node, d) for node in nodes for d in DIRECTIONS]), 1e-4)
    monkeypatch.setattr(simulator, home.__name__, lambda *_: method)
    runs = [Simulator(system, nodes, method=name) for _ in range(2)]
    pieces = [[run.step(part) for run in runs] for part in np.split(loads[:40], [7, 8, 30])]
    assert all(same(chunks, expected) for chunks in zip(*pieces, strict=True))


def test_other_outputs_do_not_change_the_motion(system, loads, whole):
    few = Simulator(system, (14,)).step(loads)
    assert np.array_equal(few.mesh_force, whole.mesh_force)
    assert few.acceleration[:, 0] == pytest.approx(whole.acceleration[:, 2], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("speed", [5.6, 500.0])
def test_the_same_operating_point_again_changes_nothing(machine, loads, speed):
    # At 500 r/min the pinions have turned two and a half times when it comes.
    unlimited = Machine(machine.base.model_copy(update={"operating_limits": None}))
    variant = unlimited.with_inputs(x1=speed)
    system = variant.assemble()
    once, again = Simulator(system, NODES), Simulator(system, NODES)
    expected = once.step(loads).mesh_force
    first = again.step(loads[:333])
    again.set_operating_point(variant.operating_point)
    second = again.step(loads[333:])
    # The phase is written anew: rounding only, of the phase and so of the forces.
    assert np.concatenate([first.mesh_force, second.mesh_force]) == pytest.approx(expected, rel=1e-8, abs=1e-3)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_loads_that_are_not_finite(system, loads, bad):
    run = Simulator(system, NODES)
    run.step(loads[:100])
    wrong = loads[100:200].copy()
    wrong[23, 4] = bad
    with pytest.raises(SimulationError, match=r"^loads at t = 0\.0123 s are not finite$"):
        run.step(wrong)
    assert run.next_step == 100  # and the run goes on as if they had never come


def test_a_run_goes_on_after_refused_loads(system, loads, whole):
    run = Simulator(system, NODES)
    first = run.step(loads[:100])
    with pytest.raises(SimulationError):
        run.step(np.full((5, 6), np.nan))
    assert same([first, run.step(loads[100:])], whole)


@pytest.mark.parametrize("shape", [(6,), (0, 6), (3, 5), (2, 2, 6)])
def test_loads_of_another_shape(system, shape):
    with pytest.raises(SimulationError, match=r"^loads: shape \(.*must be \(n, 6\)"):
        Simulator(system, NODES).step(np.zeros(shape))


def test_a_motion_that_diverges_says_when(system, loads):
    # The step is exact for the linear part, so only a machine that feeds its motion diverges: here 1e4/s.
    unstable = replace(system, C=system.C - 2e4 * system.M)
    with pytest.raises(SimulationError, match=r"^the motion diverges at t = 0\.0\d\d\d s; reduce time_step") as caught:
        Simulator(unstable, NODES).step(np.vstack([loads, loads]))
    assert 0.03 < float(str(caught.value).split()[6]) < 0.12  # e^(1e4 t) from 1e-3 to 1e308


@pytest.mark.parametrize("step", [0.0, -1e-4, np.nan])
def test_a_time_step_that_is_none(system, step):
    with pytest.raises(SimulationError, match="time_step"):
        Simulator(system, NODES, step)


def test_a_torque_ramp_is_the_torque_of_each_of_its_steps(machine, system, loads):
    point, steps = machine.operating_point, 40
    half = replace(point, torque=0.5 * point.torque)
    at_once, by_hand = Simulator(system, NODES), Simulator(system, NODES)
    for run in (at_once, by_hand):
        run.step(loads[:100])
    at_once.set_operating_point(half, over=steps)
    actual = at_once.step(loads[100:200])
    expected = []
    for k in range(100):
        share = min((k + 1) / steps, 1.0)
        by_hand.set_operating_point(replace(point, torque=point.torque * (1.0 - 0.5 * share)))
        expected.append(by_hand.step(loads[100 + k : 101 + k]).mesh_force)
    assert actual.mesh_force == pytest.approx(np.concatenate(expected), rel=1e-9)


@pytest.mark.parametrize("method", ["reduced", "full"])
def test_loads_come_in_on_a_ramp_from_their_mean(two_drives, method):
    # By hand: loads and torque beyond the mean times s² (3 − 2 s), each step handed over alone; then whole.
    point, ramp, count = two_drives.operating_point, 60, 100
    mean = two_drives.mean_load
    loads = mean * (1.0 + 0.2 * np.sin(0.7 + 0.3 * np.arange(count)))[:, None] + [0.0, 2e5, 0.0, 0.0, 1e5, 0.0]
    half = replace(point, torque=0.5 * point.torque)
    ramped, by_hand = (Simulator(two_drives, two_drives.nodes, method=method, **more) for more in ({"ramp": 6e-3}, {}))
    ramped.set_operating_point(half)
    actual, expected = [ramped.step(part) for part in np.split(loads, [1, 37])], []
    for step, row in enumerate(loads):
        s = min(step / ramp, 1.0)
        share = s**2 * (3.0 - 2.0 * s)
        by_hand.set_operating_point(replace(point, torque=point.torque * (1.0 - 0.5 * share)))
        expected.append(by_hand.step((mean + share * (row - mean))[None]))
    head = 0  # node 1, which the loads act on
    struck = Simulator(two_drives, two_drives.nodes, method=method).step(loads[:1]).acceleration[0, head]
    assert np.abs(actual[0].acceleration[0, head]).max() < 1e-3 * np.abs(struck).max()
    for part, whole in zip(joined(actual), joined(expected), strict=True):
        assert part == pytest.approx(whole, rel=1e-7, abs=1e-9 * np.abs(whole).max())


@pytest.mark.parametrize("method", ["reduced", "full"])
@pytest.mark.parametrize("step", [2e-3, 1e-2, 1.0])
def test_a_step_too_coarse_for_the_teeth(system, two_drives, step, method):
    # On every unknown each shorter step that is tried costs a second, so the reference method has fewer of them here.
    system = two_drives if method == "full" else system
    with pytest.raises(SimulationError, match=rf"^time_step {step:g} s: too coarse") as caught:
        Simulator(system, (8, 14), step, method)
    allowed = float(re.search(r"; (\S+) s is short enough$", str(caught.value))[1])
    assert 1e-4 < allowed < 2e-3
    Simulator(system, (8, 14), allowed, method)


@pytest.mark.parametrize("duration", [0.0, -1.0, 1e-6, np.nan, np.inf])
def test_a_duration_without_steps(machine, duration):
    with pytest.raises(SimulationError, match="duration"):
        simulate(machine, duration)


def test_progress_is_told_chunk_by_chunk(machine):
    seen = []
    response = simulate(machine, 0.9, progress=seen.append)
    assert seen == [pytest.approx(8192 / 9000), 1.0]
    assert response.time == pytest.approx(np.arange(9000) * 1e-4)
    assert response.mesh_force.shape == (9000, 10)


def test_only_the_nodes_asked_for(machine):
    from tbm_dynamics import MachineError

    response = simulate(machine, 0.01, outputs=(47,))
    assert response.acceleration(47).shape == (100, 6)
    assert np.array_equal(response.acceleration(47, "rz"), response.acceleration(47)[:, 5])
    assert np.array_equal(response.displacement(47, "y"), response.displacement(47)[:, 1])
    with pytest.raises(MachineError, match="node 3: not among the outputs 47"):
        response.acceleration(3)
    with pytest.raises(MachineError, match="axis 'ux': allowed are x, y, z, rx, ry, rz"):
        response.displacement(47, "ux")
    with pytest.raises(MachineError, match="node 99: unknown"):
        simulate(machine, 0.01, outputs=(99,))
