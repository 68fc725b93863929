"""Operating points that change: schedules, the limits of a machine, the loads and the run that follow.

Sources: the recorded start-up cycles of a hard-rock machine (read by numpy beside us); scales of thrust and torque by
hand; the static share of the torque, T / (n r_b). Sums written in another order: 1e-9. A mean over seconds of a
fluctuating load: bounds named there.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_files import brake, built, plain, settling

from tbm_dynamics import MachineError, OperatingPoint, simulate
from tbm_dynamics.loads.stepper import load_stepper
from tbm_dynamics.streaming.schedule import Schedule, pairs, read_schedule
from tbm_dynamics.streaming.streams import LoadStream
from tbm_dynamics.structure.drive import gear_pair

COLUMNS = {"time": "t_s", "speed": "rpm", "torque": "torque_kNm", "thrust": "thrust_kN"}
R_MIN = 2.0 * np.pi / 60.0
TIME_STEP, SAMPLES = 1e-3, 50


@pytest.fixture(scope="module")
def cycles(startup_cycles):
    names = startup_cycles.read_text("utf-8").splitlines()[0].split(",")
    kinds = [(name, "U16" if name == "cycle" else float) for name in names]
    return np.genfromtxt(startup_cycles, delimiter=",", skip_header=1, dtype=kinds, encoding="utf-8")


def test_between_rows_linear_and_held_outside():
    schedule = Schedule([1.0, 3.0], [0.2, 0.6], [1e6, 2e6], [9e6, 5e6])
    for time, share in ((0.0, 0.0), (1.0, 0.0), (1.5, 0.25), (3.0, 1.0), (9.0, 1.0)):
        expected = OperatingPoint(0.2 + 0.4 * share, 1e6 * (1.0 + share), 9e6 - 4e6 * share)
        assert vars(schedule.at(time)) == pytest.approx(vars(expected))


def test_every_recorded_cycle_is_read_to_the_number(startup_cycles, cycles):
    names = np.unique(cycles["cycle"])
    assert len(names) == 20
    for name in names:
        rows = cycles[cycles["cycle"] == name]
        schedule = read_schedule(startup_cycles, COLUMNS, {"cycle": str(name)})
        np.testing.assert_array_equal(schedule.time, rows["t_s"])
        np.testing.assert_allclose(schedule.speed, rows["rpm"] * R_MIN, rtol=1e-12)
        np.testing.assert_allclose(schedule.torque, rows["torque_kNm"] * 1e3, rtol=1e-12)
        np.testing.assert_allclose(schedule.thrust, rows["thrust_kN"] * 1e3, rtol=1e-12)


def test_the_loads_follow_every_recorded_cycle(machine, startup_cycles, cycles):
    # The ratios of torque and thrust scale unbalance forces and moments (paper, 3.1.2); at the end of every block.
    unit = machine.loads(3)
    for name in np.unique(cycles["cycle"]):
        rows = cycles[cycles["cycle"] == name]
        schedule = read_schedule(startup_cycles, COLUMNS, {"cycle": str(name)})
        stream = LoadStream(machine, 3, TIME_STEP, SAMPLES, schedule=schedule)
        blocks = [stream.next_block() for _ in range(200)]
        actual = np.array([block.loads[-1] for block in blocks])
        ends = np.arange(1, 201) * SAMPLES
        thrust, torque = (
            np.interp(ends * TIME_STEP, rows["t_s"], rows[column]) / most
            for column, most in (("thrust_kN", 12000.0), ("torque_kNm", 3040.0))
        )
        scale = np.column_stack([thrust, torque, torque, torque, thrust, thrust])
        np.testing.assert_allclose(actual, unit.evaluate((ends - 1) * TIME_STEP) * scale, rtol=1e-9)


def test_the_head_angle_is_the_integral_of_the_speed(machine, startup_cycles, cycles):
    rows = cycles[cycles["cycle"] == cycles["cycle"][0]]
    stream = LoadStream(
        machine,
        0,
        TIME_STEP,
        SAMPLES,
        "spectral",
        read_schedule(startup_cycles, COLUMNS, {"cycle": str(rows["cycle"][0])}),
    )
    blocks = [stream.next_block() for _ in range(600)]
    angle = np.unwrap([block.head_angle for block in blocks])
    speed = rows["rpm"] * R_MIN
    expected = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))])  # at whole seconds
    # The speed of a block is that of its end: off by half a block of the change.
    np.testing.assert_allclose(angle[::20], expected[: len(angle[::20])], atol=0.05 * np.ptp(speed) + 1e-9)


@pytest.mark.parametrize("level", ["spectral", "cutter"])
@settings(max_examples=15)
@given(
    thrust=st.lists(st.floats(6e6, 12e6), min_size=2, max_size=5),
    speed=st.lists(st.floats(0.15, 0.7), min_size=2, max_size=5),
    seed=st.integers(0, 3),
)
def test_no_jump_where_blocks_meet(machine, level, thrust, speed, seed):
    rows = min(len(thrust), len(speed))
    schedule = Schedule(0.13 * np.arange(rows), speed[:rows], np.full(rows, 2e6), thrust[:rows])
    stream = LoadStream(machine, seed, 1e-5, 1000, level, schedule)
    loads = np.concatenate([stream.next_block().loads for _ in range(40)])
    steps = np.abs(np.diff(loads, axis=0))
    inside = np.delete(steps, np.arange(999, len(steps), 1000), axis=0).max(axis=0)
    # The steepest a smooth signal gets inside of blocks is also what it does between them, give or take the slope of
    # the one step that the thrust's ramp takes there.
    assert np.all(steps[999::1000].max(axis=0) <= inside * 1.05 + 2e-3 * np.abs(loads).max(axis=0))


def test_a_run_carries_the_torque_of_its_schedule():
    # Static share of the torque: mean mesh force over two periods of the slowest line of the loads (0.9 Hz), 2 %
    # for the noise that is left.
    machine = built(settling())
    schedule = Schedule([0.0, 0.5, 1.0], [0.5, 0.5, 0.3], [2.4e6, 2.4e6, 1.2e6], [9e6, 9e6, 8e6])
    response = simulate(machine, 4.0, seed=1, schedule=schedule)
    drive = machine.description.driveshaft
    share = drive.count * gear_pair(drive).ring_base_radius
    quiet = response.mesh_force[-22_222:].mean()
    assert quiet == pytest.approx((1.2e6 + 0.3 * brake(plain())) / share, rel=0.02)
    mean = (0.5 * 2.4e6 + 0.5 * 1.8e6 + 3.0 * 1.2e6) / 4.0
    assert response.static_mesh_force == pytest.approx(mean / share, rel=0.01)  # linear over blocks of 50 ms


def test_a_schedule_of_one_row_is_the_machine_with_that_point(machine):
    variant = machine.with_inputs(x1=5.0, x2=2000.0, x3=9000.0)
    point = variant.operating_point
    schedule = Schedule([0.0], [point.speed], [point.torque], [point.thrust])
    same = simulate(machine, 0.2, seed=2, schedule=schedule)
    expected = simulate(variant, 0.2, seed=2)
    np.testing.assert_allclose(same.mesh_force, expected.mesh_force, rtol=1e-9)


def test_on_the_cutter_level_the_discs_give_the_torque(machine):
    loads = load_stepper(machine, "cutter", seed=5)
    wanted = OperatingPoint(0.4, 1.0, 9e6)
    reached = loads.reached(wanted)
    assert (reached.speed, reached.thrust) == (wanted.speed, wanted.thrust)
    assert loads.mean(wanted)[[0, 3]] == pytest.approx([-9e6, -reached.torque], rel=1e-6)
    # The same chips press less: what the discs add to the friction goes with their normal force.
    time = np.arange(2000) * 1e-3
    strong = OperatingPoint(0.4, 1.0, 12e6)
    weak, full = (loads.evaluate(point, point, time, 0.4 * time)[:, 0] + 4.48e6 for point in (wanted, strong))
    np.testing.assert_allclose(weak / full, (9e6 - 4.48e6) / (12e6 - 4.48e6), rtol=1e-6)


@pytest.mark.parametrize(
    ("point", "message"),
    [
        (OperatingPoint(0.9, 1e6, 9e6), "speed 8.59437 r/min, allowed are up to 7.6"),
        (OperatingPoint(0.3, 9e6, 9e6), "torque 9000 kN·m, allowed are up to 8410"),
        (OperatingPoint(0.3, 1e6, 3e7), "thrust 30000 kN, allowed are up to 23000"),
        (OperatingPoint(0.7, 6e6, 9e6), "power 4200 kW, allowed are up to 3500"),
        (OperatingPoint(-0.1, 1e6, 9e6), "speed must be positive, or 0 at a standstill"),
        (OperatingPoint(0.3, -1.0, 9e6), "torque and thrust not negative"),
    ],
)
def test_operating_points_beyond_the_machine(machine, point, message):
    with pytest.raises(MachineError, match=f"^operating point: .*{message}"):
        LoadStream(machine, 0, TIME_STEP, SAMPLES).set_operating_point(point)
    columns = (
        [getattr(one, name) for one in (machine.operating_point, point)] for name in ("speed", "torque", "thrust")
    )
    with pytest.raises(MachineError, match=f"^schedule: row 2: operating point: .*{message}"):
        LoadStream(machine, 0, TIME_STEP, SAMPLES, schedule=Schedule([0.0, 1.0], *columns))


def test_the_cutter_level_refuses_a_thrust_below_friction(machine):
    stream = LoadStream(machine, 0, TIME_STEP, SAMPLES, "cutter")
    with pytest.raises(MachineError, match=r"^operating point: thrust 4000 kN, allowed are 4480 kN, which friction"):
        stream.set_operating_point(replace(machine.operating_point, thrust=4e6))
    scheduled = LoadStream(machine, 0, TIME_STEP, SAMPLES, schedule=Schedule([0], [0.5], [1e6], [9e6]))
    with pytest.raises(MachineError, match="the loads follow a schedule"):
        scheduled.set_operating_point(machine.operating_point)
    with pytest.raises(MachineError, match="loads 'rock': allowed are spectral, cutter"):
        load_stepper(machine, "rock")


def test_a_machine_file_beyond_its_own_limits(machine):
    with pytest.raises(MachineError, match="thrust 24000 kN, allowed are up to 23000"):
        machine.with_inputs(x3=24000.0)


HEADER = "time_s,speed_r_min,torque_kn_m,thrust_kn"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: no column 'time_s', allowed: names in the first line, commas between them, and decimal points"),
        (
            HEADER.replace(",", ";") + "\n0;5,5;2000;9000\n",
            "line 1: no column 'time_s', allowed: names in the first line",
        ),
        ("time_s,speed_r_min,thrust_kn\n0,5,9000\n", "line 1: no column 'torque_kn_m', there are time_s"),
        (HEADER + "\n", "no row"),
        (HEADER + "\n0,5,2000,9000\n1,5,,9000\n", "line 3, column torque_kn_m: empty, allowed is a finite number"),
        (HEADER + "\n0,5,2000,9000\n1,fast,2000,9000\n", "line 3, column speed_r_min: 'fast', allowed"),
        (HEADER + "\n0,5,2000,9000\n1,5,2000\n", "line 3, column thrust_kn: empty"),
        (HEADER + "\n0,5,2000,nan\n", "line 2, column thrust_kn: 'nan', allowed"),
        (HEADER + "\n0,5,2000,9000\n\n0,5,2000,9000\n", "line 4: time 0 s, allowed is later than the row before"),
        (HEADER + "\n0,5,5,2000,9000\n", "line 2: more cells than the 4 of the header, allowed: one a column"),
        (HEADER + ",thrust_kn\n0,5,2000,9000,8000\n", "line 1: column 'thrust_kn' stands twice, allowed: once"),
        (HEADER + "\n0,5,2_000,9000\n", "line 2, column torque_kn_m: '2_000', allowed"),
        (HEADER + "\n0,5,٢٠٠٠,9000\n", "line 2, column torque_kn_m: '٢٠٠٠', allowed"),
    ],
)
def test_bad_files_name_row_and_column(tmp_path, text, message):
    file = tmp_path / "cycle.csv"
    file.write_text(text, "utf-8")
    with pytest.raises(MachineError, match=f"cycle.csv: {message}"):
        read_schedule(file)


def test_what_else_can_be_wrong(tmp_path):
    with pytest.raises(MachineError, match=r"nowhere\.csv: No such file or directory, allowed: a CSV file"):
        read_schedule(tmp_path / "nowhere.csv")
    file = tmp_path / "cycle.csv"
    file.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(MachineError, match="no UTF-8 text"):
        read_schedule(file)
    file.write_text(HEADER + "\n0,5,2000,9000\n", "utf-8")
    file.write_text(HEADER + "\n0,5,2000,9000\n1,5,2000,1e30\n", "utf-8")
    with pytest.raises(
        MachineError, match=r"cycle\.csv: line 3: operating point: a value that is not finite or absurd"
    ):
        list(read_schedule(file).rows())
    file.write_text(HEADER + "\n0,5,2000,9000\n", "utf-8")
    with pytest.raises(MachineError, match="columns: pressure: allowed are time, speed, torque, thrust"):
        read_schedule(file, {"pressure": "p"})
    with pytest.raises(MachineError, match="no row with time_s = '7'"):
        read_schedule(file, where={"time_s": "7"})
    with pytest.raises(MachineError, match="--where: 'cycle', allowed is key=value"):
        pairs("--where", ["cycle"])
    with pytest.raises(MachineError, match="one shape"):
        Schedule([0.0, 1.0], [0.5], [1e6], [9e6])
    with pytest.raises(MachineError, match="row 2: thrust is no finite number"):
        Schedule([0.0, 1.0], [0.5, 0.5], [1e6, 1e6], [9e6, np.inf])
