"""Levels of operation: the documented rule on operating points written down here, and a comparison at two levels."""

import numpy as np
import pytest
from compare_bags import START_NS, model_values, noise, write_bag

from tbm_dynamics import load_machine
from tbm_gsa.comparison.levels import MOST_LEVELS, NeverDrivenError, machine_history, recorded_history
from tbm_gsa.comparison.workflow import compare_recording
from tbm_msgs_py import OperatingPoint
from tbm_msgs_py.base.units import R_MIN
from tbm_msgs_py.recordings.operating import OperatingRecord

SECOND = 1_000_000_000


def record(*entries, start=0.0):
    """(s, r/min, kN·m, kN) …"""
    points = tuple(OperatingPoint(speed * R_MIN, 1e3 * torque, 1e3 * thrust) for _, speed, torque, thrust in entries)
    time = np.array([at for at, *_ in entries])
    return OperatingRecord(START_NS + round((start + time[0]) * SECOND), time - time[0], points)


def history(entries, end=100.0):
    return recorded_history(record(*entries), START_NS, START_NS + round(end * SECOND))


def values(level):
    return level.speed_r_min, level.torque_kn_m, level.thrust_kn


def segments(found):
    return [((d.begin_ns - START_NS) / SECOND, (d.end_ns - START_NS) / SECOND, d.kind, d.level) for d in found.segments]


def test_two_levels_and_the_ramp_between_them():
    ramp = [(40.0 + i, 5.0 + 0.4 * i, 2000.0, 9000.0) for i in range(1, 5)]
    found = history([(0.0, 5.0, 2000.0, 9000.0), *ramp, (45.0, 7.0, 2000.0, 9000.0)])
    assert [values(level) for level in found.levels] == [
        pytest.approx((7.0, 2000.0, 9000.0)),
        pytest.approx((5.0, 2000.0, 9000.0)),
    ]
    assert [level.seconds for level in found.levels] == pytest.approx([55.0, 41.0])
    assert segments(found)[0] == (0.0, 41.0, "steady", 1)
    assert segments(found)[-1] == (45.0, 100.0, "steady", 0)
    assert all(kind == "transient" and level is None for _, _, kind, level in segments(found)[1:-1])
    level_of = found.level_of(START_NS + 2 * SECOND)  # of a point whose first sample comes 2 s later
    begin = np.array([0.0, 36.0, 38.0, 40.0, 42.0, 43.0, 96.0])
    assert level_of(begin, begin + 2.0).tolist() == [1, 1, -1, -1, -1, 0, 0]


def test_noise_within_the_tolerance_is_one_level_at_its_mean():
    rng = np.random.default_rng(0)
    entries = [(float(i), 5.6, 3000.0 * (1.0 + rng.uniform(-0.04, 0.04)), 12000.0) for i in range(100)]
    found = history(entries)
    assert len(found.levels) == len(found.segments) == 1
    assert found.levels[0].torque_kn_m == pytest.approx(np.mean([entry[2] for entry in entries]))


def test_a_level_may_come_back_and_a_standstill_has_none():
    up, down = (5.6, 3000.0, 12000.0), (4.0, 2500.0, 8000.0)
    found = history([(0.0, *up), (20.0, *down), (40.0, 0.0, 0.0, 0.0), (60.0, *up)])
    assert [level.seconds for level in found.levels] == pytest.approx([60.0, 20.0])
    assert [(kind, level) for *_, kind, level in segments(found)] == [
        ("steady", 0),
        ("steady", 1),
        ("standstill", None),
        ("steady", 0),
    ]


def test_the_first_operating_point_holds_before_itself_too():
    assert history([(30.0, 5.6, 3000.0, 12000.0)]).levels[0].seconds == pytest.approx(100.0)
    found = history([(-50.0, 9.0, 1000.0, 1000.0), (-10.0, 4.0, 2000.0, 9000.0), (50.0, 5.6, 3000.0, 12000.0)])
    assert sorted(level.seconds for level in found.levels) == pytest.approx([50.0, 50.0])


def test_only_so_many_levels_are_compared():
    entries = [(12.0 * i, 2.0 + i, 3000.0, 12000.0) for i in range(7)]
    found = history(entries, 84.0)
    assert len(found.levels) == MOST_LEVELS
    assert "3 more levels, 36 s in all, are left out" in found.levels[0].note
    assert [kind for *_, kind, level in segments(found) if level is None] == ["transient"] * 3


def test_what_was_never_steady_is_taken_at_its_mean():
    found = history([(0.0, 4.0, 2000.0, 9000.0), (5.0, 8.0, 2000.0, 9000.0)], 10.0)
    assert values(found.levels[0]) == pytest.approx((6.0, 2000.0, 9000.0))
    assert "never steady" in found.levels[0].note
    assert found.level_of(START_NS)(np.array([4.0]), np.array([6.0])).tolist() == [0]


def test_a_machine_that_never_turned_is_an_error():
    with pytest.raises(NeverDrivenError, match="never driven"):
        history([(0.0, 0.0, 0.0, 0.0)])


def test_without_operating_points_the_level_is_the_machines_own():
    own = machine_history(load_machine("dz101"), START_NS, START_NS + SECOND)
    assert values(own.levels[0]) == (5.6, 3040.0, 12000.0)
    assert own.levels[0].source == "machine"


def test_every_window_is_held_against_its_level(tmp_path):
    """The model's own recordings at two levels, one after the other: no error at either, none in between."""
    low = OperatingPoint(5.6 * R_MIN, 3.04e6, 6.0e6)
    high = OperatingPoint(5.6 * R_MIN, 3.04e6, 1.2e7)
    machine = load_machine("dz101")
    parts = [model_values(0, 12.0, machine.with_inputs(x3=thrust))["girder"] for thrust in (6000.0, 12000.0)]
    signal = np.concatenate([parts[0], np.zeros((10_000, 3)), parts[1][:110_000]])  # 24 s
    path = write_bag(
        tmp_path / "bag",
        {"girder": signal, "shield": noise(12.5)},
        operating=[(0.0, low), (12.0, OperatingPoint(0.5, 3.04e6, 9.0e6)), (13.0, high)],
        rate=10_000,
    )
    result = compare_recording(path, model_duration=12.0).result
    assert [level.thrust_kn for level in result.levels] == pytest.approx([6000.0, 12000.0], rel=1e-9)
    axis = result.points["girder"]["x"]
    assert axis.windows.level == (0, 0, 0, 0, 0, 0, None, 1, 1, 1, 1, 1)
    assert axis.windows.relative_error[6] is None
    for place, level in enumerate(result.levels):
        assert level.points["girder"]["x"].relative_error < 0.1, place  # but for the windows at the change
    inside = [level is not None for level in axis.windows.level]
    field = np.array(axis.windows.field_rms)[inside].astype(float)
    assert axis.field_rms == pytest.approx(np.sqrt(np.mean(field**2)), rel=1e-6)
    rms = np.array([level.points["girder"]["x"].model_rms for level in result.levels])
    assert axis.model_rms == pytest.approx(np.sqrt((6 * rms[0] ** 2 + 5 * rms[1] ** 2) / 11), rel=1e-6)
    assert list(result.levels[1].points["shield"]) == []  # its recording ended before
