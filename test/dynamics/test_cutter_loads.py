"""Cutterhead loads from the discs: means, purity, spectrum, chance.

Sources: Table 1 (12 000 kN, 3 040 kN·m: thrust by construction, torque within 5 %); Shock and Vibration 2018, 8798232
(energy of cutter forces mainly below 10 Hz); Parseval by scipy's periodogram; the wrench of the mean forces, turned
with the head. Bounds of averages are five times their standard error, taken from the run itself in blocks of 10 s.
"""

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_files import TEXT, built, plain, with_cutters

from tbm_dynamics import load_machine
from tbm_dynamics.loads.cutters.cutter_loads import CutterLoads
from tbm_dynamics.loads.cutters.description import CutterError, Fracture
from tbm_msgs_py.base.errors import MachineError

RATE = 500.0


@pytest.fixture(scope="module")
def machine():
    return load_machine("dz101")


@pytest.fixture(scope="module")
def loads(machine):
    return machine.cutter_loads(seed=11)


@pytest.fixture(scope="module")
def record(loads):
    """400 s, (n, 6)."""
    return loads.evaluate(np.arange(200_000) / RATE)


def test_thrust_and_torque_of_table_1(loads):
    assert loads.mean[0] == pytest.approx(-12e6, rel=1e-6)
    assert loads.mean[3] == pytest.approx(-3.04e6, rel=0.05)
    assert loads.penetration == pytest.approx(9.9e-3, rel=0.15)  # of formulas by hand, without tilt and twins


def test_a_long_run_has_the_mean(loads, record):
    blocks = record[:, [0, 3]].reshape(40, -1, 2).mean(axis=1)
    error = blocks.std(axis=0) / np.sqrt(40)
    assert np.all(np.abs(blocks.mean(axis=0) - loads.mean[[0, 3]]) < 5.0 * error)
    assert np.all(error < 2e-3 * np.abs(loads.mean[[0, 3]]))


def test_what_is_out_of_balance_turns_with_the_head(loads, record):
    # Amplitude at the rotation frequency over whole turns against the sum of the mean forces.
    speed = loads.speed
    steps = round(37 * 2.0 * np.pi / speed * RATE)
    wave = np.exp(-1j * speed * np.arange(steps) / RATE)
    lateral = (record[:steps, 1] + 1j * record[:steps, 2]) * wave
    expected = loads.head.wrenches(loads.penetration).sum(axis=0)
    blocks = np.array([part.mean() for part in np.array_split(lateral, 37)])
    error = np.abs(blocks - blocks.mean()).std() / np.sqrt(37)
    assert abs(lateral.mean() - (expected[1] + 1j * expected[2])) < 5.0 * error
    assert error < 0.1 * abs(expected[1] + 1j * expected[2])


def test_most_of_the_energy_is_below_10_hz(loads):
    values = loads.evaluate(np.arange(400_000) * 5e-4)
    fluctuation = values - values.mean(axis=0)
    frequency, power = scipy.signal.periodogram(fluctuation, 2000.0, axis=0)
    # Parseval: the spectrum holds the variance.
    assert power.sum(axis=0) * frequency[1] == pytest.approx(fluctuation.var(axis=0), rel=1e-6)
    share = power[frequency < 10.0].sum(axis=0) / power.sum(axis=0)
    assert np.all(share[[0, 3]] > 0.6)
    assert np.all(share > 0.5)


places = st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=40)


@settings(max_examples=25)
@given(times=places, cut=st.integers(0, 40), data=st.data())
def test_any_window_in_any_order_gives_the_same_bits(machine, times, cut, data):
    at = np.array(times)
    whole = machine.cutter_loads(seed=3).evaluate(at)
    other = machine.cutter_loads(seed=3)
    pieces = np.concatenate([other.evaluate(at[:cut]), other.evaluate(at[cut:])])
    assert np.array_equal(whole, pieces)
    order = np.array(data.draw(st.permutations(range(len(times)))))
    assert np.array_equal(whole[order], machine.cutter_loads(seed=3).evaluate(at[order]))
    assert np.array_equal(whole, other.evaluate(at, other.speed * at))


def test_windows_and_seeds_have_nothing_in_common(machine, record):
    other = machine.cutter_loads(seed=12).evaluate(np.arange(200_000) / RATE)
    for column in (0, 3):
        first, second, strange = record[:100_000, column], record[100_000:, column], other[:100_000, column]
        for values in (second, strange):
            # 200 s with energy below some 10 Hz are more than 2000 independent values.
            assert abs(np.corrcoef(first, values)[0, 1]) < 5.0 / np.sqrt(2000)


@pytest.mark.parametrize("along", ["angle", "time"])
def test_no_disc_leaves_its_heights_and_none_jumps(machine, along):
    head = machine.cutter_loads().head
    fracture = Fracture(along=along, chip=0.2, jitter=0.9, heights=(0.2, 0.5), release=0.2, source="test")
    lone = with_cutters(
        type(head)(head.description, type(head.layout)(*(part[40:41] for part in vars(head.layout).values()))),
        fracture=fracture,
        side_share=0.0,
        friction_kn=0.0,
        idle_torque_kn_m=0.0,
    )
    loads = CutterLoads(lone, 120e3, 0.6, seed=2)
    values = loads.evaluate(np.arange(200_000) * 1e-3)
    force = values[:, 0] / loads.mean[0] - 1.0
    assert 0.4 < np.abs(force).max() <= 0.5
    assert force.mean() == pytest.approx(0.0, abs=0.02)
    # The steepest fall: twice the height in the release of the shortest tooth, a tenth of the mean one.
    cycle = 1e-3 / 0.2 * (0.6 * lone.layout.radius[0] if along == "angle" else 1.0)
    assert np.abs(np.diff(force)).max() < 0.5 * np.pi * 1.0 * cycle / (0.2 * 0.1)


def test_bad_operating_points_are_refused(machine):
    head = machine.cutter_loads().head
    with pytest.raises(CutterError, match=r"^thrust 4000 kN, allowed are 4480 kN, which friction takes up, to \d+ kN"):
        CutterLoads(head, 4e6, 0.6)
    with pytest.raises(CutterError, match=r"^thrust 90000 kN, allowed"):
        CutterLoads(head, 9e7, 0.6)
    for speed in (0.0, -1.0, np.nan):
        with pytest.raises(CutterError, match="speed"):
            CutterLoads(head, 12e6, speed)
    with pytest.raises(ValueError, match="finite"):
        machine.cutter_loads().evaluate([0.0, np.inf])


def test_a_machine_file_without_cutters_or_with_wrong_ones():
    with pytest.raises(MachineError, match=r"^open380: cutters: missing"):
        load_machine("open380").cutter_loads()
    data = plain()
    data["cutters"]["layout"] = "nowhere.csv"
    with pytest.raises(MachineError, match=r"^dz101: cutters: nowhere\.csv: No such file"):
        built(data).cutter_loads()
    data = plain()
    data["cutters"]["head_radius"] = 3.0
    with pytest.raises(MachineError, match=r"^dz101: cutters: dz101_cutters\.csv: line \d+, column radius_m"):
        built(data).cutter_loads()


def test_a_layout_beside_the_machine_file(tmp_path):
    rows = "cutter,type,radius_m,angle_deg,tilt_deg\n1,face,2.0,0,0\n2,face,2.1,180,0\n"
    (tmp_path / "mine.csv").write_text(rows, "utf-8")
    path = tmp_path / "mine.yaml"
    path.write_text(
        TEXT.replace("layout: dz101", "layout: mine.csv").replace("friction_kn: 4480", "friction_kn: 11700")
    )
    assert len(load_machine(path).cutter_loads().head.layout.radius) == 2
