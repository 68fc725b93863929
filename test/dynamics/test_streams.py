"""Live streams: blocks with gaps, restarts and changes of the operating point.

Source: `simulate` and one long `Simulator.step`; a live run gives the same bits as an offline one, so there is no
tolerance except where a sum is written in another order.
"""

from dataclasses import replace

import numpy as np
import pytest
from machine_files import brake, built, plain, settling

from tbm_dynamics import SimulationError, Simulator, simulate
from tbm_dynamics.integration import LOAD_RAMP
from tbm_dynamics.streaming.streams import DynamicsStream, LoadStream, step_ns

RATE, TIME_STEP, SAMPLES = 10_000.0, 1e-4, 200
EPOCH = 1_700_000_000_123_456_789
STEP = 100_000


def blocks(machine, count, seed=4):
    stream = LoadStream(machine, seed, TIME_STEP, SAMPLES)
    return [stream.next_block() for _ in range(count)]


def stamp(block):
    return EPOCH + block.first_step * STEP


def forces(chunks):
    return np.concatenate([chunk.mesh_force for chunk in chunks])


def test_blocks_are_the_loads_of_the_machine(machine):
    actual = blocks(machine, 5)
    assert [block.first_step for block in actual] == [0, 200, 400, 600, 800]
    expected = machine.loads(4).evaluate(np.arange(1000) * 1e-4)
    assert np.array_equal(np.concatenate([block.loads for block in actual]), expected)
    angles = np.array([block.head_angle for block in actual])
    assert angles == pytest.approx(machine.operating_point.speed * np.arange(5) * 0.02)


def test_the_head_angle_stays_within_a_turn(machine):
    long = LoadStream(machine, 0, 1.0, 100)  # s
    angles = np.array([long.next_block().head_angle for _ in range(5)])
    assert angles == pytest.approx(machine.operating_point.speed * 100.0 * np.arange(5) % (2.0 * np.pi))


BAD = {3: {"tooth": {"fault": "crack", "share": 0.4}}, 7: {"torque_share": 1.2}, 8: {"torque_share": 0.2}}


@pytest.mark.parametrize("drives", [{}, BAD])
def test_a_live_run_is_the_offline_run(drives):
    machine = built({**plain(), "drives": drives})
    stream = DynamicsStream(machine, RATE)
    stream.warm_up()
    chunks = [chunk for block in blocks(machine, 6) for chunk in stream.process(stamp(block), block.loads)]
    offline = simulate(machine, 0.12, seed=4)
    assert stream.nodes == offline.nodes
    assert np.array_equal(forces(chunks), offline.mesh_force)
    assert np.array_equal(np.concatenate([chunk.acceleration for chunk in chunks]), offline.accelerations)
    assert np.array_equal(np.concatenate([chunk.displacement for chunk in chunks]), offline.displacements)
    assert (stream.lost_steps, stream.restarts, stream.epoch_ns) == (0, 0, EPOCH)


def test_a_lost_block_is_bridged_by_a_straight_line(machine):
    sent = blocks(machine, 12)
    stream, received = DynamicsStream(machine, RATE), (0, 1, *range(4, 12))
    chunks = [chunk for i in received for chunk in stream.process(stamp(sent[i]), sent[i].loads)]
    assert [chunk.first_step for chunk in chunks] == [0, 200, 400, *range(800, 2400, 200)]
    assert (stream.lost_steps, stream.restarts, stream.dropped) == (400, 0, 0)
    known = np.concatenate([np.arange(400), np.arange(800, 2400)])
    given = np.concatenate([sent[i].loads for i in received])
    bridged = np.column_stack([np.interp(np.arange(2400), known, column) for column in given.T])
    expected = Simulator(machine.assemble(), stream.nodes, ramp=LOAD_RAMP).step(bridged)
    assert forces(chunks) == pytest.approx(expected.mesh_force, rel=1e-9)
    jump = np.abs(np.diff(forces(chunks), axis=0)).max(axis=1)
    for border in (399, 799):  # where the gap begins and ends the state does not jump
        assert abs(jump[border] - jump[[border - 1, border + 1]].mean()) < 0.1 * np.median(jump)


def test_a_stamp_a_little_off_the_grid_belongs_to_its_step(machine):
    sent = blocks(machine, 2)
    stream = DynamicsStream(machine, RATE)
    stream.process(EPOCH, sent[0].loads)
    (chunk,) = stream.process(stamp(sent[1]) + STEP // 3, sent[1].loads)
    assert chunk.first_step == 200
    assert stream.lost_steps == 0


@pytest.mark.parametrize("jump", [-20_001, -100, 20_001])
def test_a_jump_back_or_a_long_gap_starts_afresh(machine, jump):
    sent = blocks(machine, 8)
    stream = DynamicsStream(machine, RATE)
    first = [chunk for block in sent for chunk in stream.process(stamp(block), block.loads)]
    later = EPOCH + (8 * SAMPLES + jump) * STEP
    again = [chunk for block in sent for chunk in stream.process(later + block.first_step * STEP, block.loads)]
    assert [chunk.first_step for chunk in again] == [200 * k for k in range(8)]
    assert np.array_equal(forces(again), forces(first))
    assert (stream.restarts, stream.lost_steps, stream.dropped, stream.epoch_ns) == (1, 0, 0, later)


@pytest.mark.parametrize("offset", [-70, 70, 10_000, -(10**8)])
def test_a_second_publisher_changes_no_bit(machine, offset):
    sent, alone = blocks(machine, 6), DynamicsStream(machine, RATE)
    expected = [alone.process(stamp(block), block.loads)[-1].mesh_force for block in sent]
    stream = DynamicsStream(machine, RATE)
    actual = []
    for block in sent:
        actual += stream.process(stamp(block), block.loads)
        assert stream.process(stamp(block) + offset * STEP, 2.0 * block.loads) == []
    stream.process(stamp(sent[-1]) + SAMPLES * STEP, sent[-1].loads)
    assert np.array_equal(forces(actual), np.concatenate(expected))
    assert (stream.dropped, stream.restarts, stream.lost_steps) == (6, 0, 0)


def test_an_operating_point_holds_from_its_stamp_on(machine):
    half = replace(machine.operating_point, torque=0.5 * machine.operating_point.torque)
    sent, runs = blocks(machine, 4), []
    for early in (0, 2):
        stream = DynamicsStream(machine, RATE)
        forces_found = []
        for number, block in enumerate(sent):
            if number == 2 - early:
                stream.set_operating_point(half, stamp(sent[2]))
            forces_found.append(stream.process(stamp(block), block.loads)[-1].mesh_force)
        runs.append(np.concatenate(forces_found))
    assert np.array_equal(*runs)


@pytest.mark.parametrize(("gap", "lost", "restarts"), [(500, 500, 0), (501, 0, 1)])
def test_the_longest_gap_that_is_bridged(machine, gap, lost, restarts):
    sent = blocks(machine, 9)
    stream = DynamicsStream(machine, RATE, longest_bridge=0.05)
    stream.process(EPOCH, sent[0].loads)
    for block in sent[1:]:
        stream.process(stamp(block) + gap * STEP, block.loads)
    assert (stream.lost_steps, stream.restarts) == (lost, restarts)


def test_refused_loads_become_a_gap(machine):
    sent = blocks(machine, 10)
    stream = DynamicsStream(machine, RATE)
    stream.process(stamp(sent[0]), sent[0].loads)
    with pytest.raises(SimulationError, match="not finite"):
        stream.process(stamp(sent[1]), np.full((SAMPLES, 6), np.nan))
    chunks = [chunk for block in sent[2:] for chunk in stream.process(stamp(block), block.loads)]
    assert [chunk.first_step for chunk in chunks] == [200 * k for k in range(1, 10)]
    assert (stream.lost_steps, stream.dropped) == (200, 0)


def test_a_new_operating_point_is_reached_over_one_block(machine):
    stream = LoadStream(machine, 4, TIME_STEP, SAMPLES)
    still = LoadStream(machine, 4, TIME_STEP, SAMPLES)
    before = machine.operating_point
    after = replace(before, thrust=0.8 * before.thrust, torque=0.5 * before.torque, speed=1.1 * before.speed)
    stream.next_block(), still.next_block()
    stream.set_operating_point(after)
    actual, same = stream.next_block(), still.next_block()
    share = np.arange(1, SAMPLES + 1) / SAMPLES
    assert actual.loads[:, 0] == pytest.approx(same.loads[:, 0] * (1.0 - 0.2 * share))
    assert actual.loads[:, 3] == pytest.approx(same.loads[:, 3] * (1.0 - 0.5 * share))
    assert actual.operating_point == after
    later, unchanged = stream.next_block(), still.next_block()
    factors = [0.8, 0.5, 0.5, 0.5, 0.8, 0.8]  # thrust moves F_x, M_y, M_z; torque the rest
    assert later.loads == pytest.approx(unchanged.loads * factors)
    assert (later.head_angle - actual.head_angle) / (unchanged.head_angle - same.head_angle) == pytest.approx(1.1)


def test_a_run_starts_in_the_equilibrium_of_its_operating_point(machine):
    # An operating point that comes before the first block is where the run starts: as the variant does offline.
    variant = machine.with_inputs(x1=5.9, x2=1800.0, x3=9000.0)
    sent = blocks(variant, 8)
    run = Simulator(variant.assemble(), (3,), ramp=LOAD_RAMP)
    expected = run.step(np.concatenate([block.loads for block in sent])).mesh_force
    stream = DynamicsStream(machine, RATE)
    stream.set_operating_point(variant.operating_point)
    for start in (EPOCH, EPOCH - 10**12):
        chunks = [chunk for block in sent for chunk in stream.process(start + block.first_step * STEP, block.loads)]
        assert forces(chunks) == pytest.approx(expected, rel=1e-9)
    assert stream.restarts == 1


def test_a_change_during_the_run_moves_the_mean_mesh_force():
    machine = built(settling())
    stream, loads = DynamicsStream(machine, RATE), LoadStream(machine, 4, TIME_STEP, SAMPLES)
    half = replace(machine.operating_point, torque=0.5 * machine.operating_point.torque)
    means = []
    for i in range(90):
        if i == 15:
            loads.set_operating_point(half)
            stream.set_operating_point(half)
        block = loads.next_block()
        means.append(stream.process(stamp(block), block.loads)[-1].mesh_force.mean())
    assert stream.restarts == 0
    # Over 0.3 s and 0.9 s of a fluctuating load; the head is braked as before.
    moment = brake(plain()) * half.speed
    expected = (half.torque + moment) / (2.0 * half.torque + moment)
    assert np.mean(means[45:]) / np.mean(means[:15]) == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize(("rate", "length"), [(1000.0, 1_000_000), (5000.0, 200_000), (10_000.0, 100_000)])
def test_steps_of_whole_nanoseconds(rate, length):
    assert step_ns(rate) == length


def test_a_rate_without_whole_nanoseconds():
    with pytest.raises(ValueError, match="rate 3000 Hz: its step must be a whole number of ns; allowed are 1000, 5000"):
        step_ns(3000.0)
