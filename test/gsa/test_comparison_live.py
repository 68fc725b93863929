from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats
from compared_signals import compared, conditioned
from hypothesis import given, settings
from hypothesis import strategies as st

from tbm_gsa.comparison import (
    AlarmRule,
    UsualRatio,
    WindowedComparison,
    WindowResult,
    dead_axes,
)
from tbm_gsa.signals.conditioning import common_band
from tbm_gsa.signals.statistics import kurtosis, rms
from tbm_gsa.signals.windows import WindowSums

SECOND = 1_000_000_000
EPOCH = 1_700_000_000 * SECOND  # a multiple of the window
RATES = {"model": 5000, "field": 1000}
AMPLITUDES = {"model": np.array([3.0, 2.0, 1.0]), "field": np.array([2.0, 2.0, 4.0])}

Block = tuple[str, int, np.ndarray, np.ndarray]


def noise(source: str, duration: float) -> np.ndarray:
    """Gaussian accelerations with gravity, (n, 3)."""
    rng = np.random.default_rng(sum(map(ord, source)))
    return rng.standard_normal((round(duration * RATES[source]), 3)) * AMPLITUDES[source] + [0.0, 0.0, 9.81]


def blocks(source: str, duration: float, start: float = 0.0, length: float = 0.05) -> Iterator[Block]:
    """(source, stamp_ns, t, values) of a whole signal, `length` s each."""
    values, size = noise(source, duration), round(length * RATES[source])
    for first in range(0, len(values), size):
        part = values[first : first + size]
        stamp = EPOCH + round((start + first / RATES[source]) * SECOND)
        yield source, stamp, np.arange(len(part)) / RATES[source], part


def interleaved(duration: float, start: float = 0.0) -> list[Block]:
    return sorted([*blocks("model", duration, start), *blocks("field", duration, start)], key=lambda block: block[1])


def run(comparison: WindowedComparison, stream: list[Block], point: str = "shield") -> list[WindowResult]:
    return [result for block in stream for result in comparison.feed(point, *block)]


def starts(results: list[WindowResult]) -> list[float]:
    return [(result.start_ns - EPOCH) / SECOND for result in results]


def offline_rms(source: str, duration: float, window: float, edge: float, *rates: float) -> np.ndarray:
    values, rate = noise(source, duration), RATES[source]
    whole = conditioned(np.arange(len(values)) / rate, values, rate, common_band(*(rates or RATES.values())))
    inside = whole[round(edge * rate) : round((edge + window) * rate)]
    return np.sqrt(np.mean(inside**2, axis=0))


def test_windows_agree_with_the_offline_ones():
    results = run(WindowedComparison(2.0), interleaved(12.0))
    assert starts(results) == [2.0, 4.0, 6.0, 8.0, 10.0]
    for result, edge in zip(results, starts(results), strict=True):
        np.testing.assert_allclose(result.model_rms, offline_rms("model", 12.0, 2.0, edge), rtol=0.01)
        np.testing.assert_allclose(result.field_rms, offline_rms("field", 12.0, 2.0, edge), rtol=0.01)
        expected = np.abs(result.field_rms - result.model_rms) / result.field_rms
        np.testing.assert_allclose(result.relative_error, expected)
        assert result.coverage == 1.0


@pytest.mark.parametrize("frame", ["fixed", "rotating"])
def test_live_and_offline_peaks_and_kurtoses_agree(frame):
    """A blow in every window, as of a damaged bearing; the filters differ in phase, which changes single peaks."""
    duration = 12.0
    signals = {source: noise(source, duration) for source in RATES}
    times = {source: np.arange(len(values)) / RATES[source] for source, values in signals.items()}
    since = times["field"] % 0.5
    signals["field"] += (np.exp(-since / 0.01) * np.sin(2 * np.pi * 120.0 * since))[:, None] * [60.0, 40.0, 80.0]
    comparison = WindowedComparison(2.0, rotating=["shield"] if frame == "rotating" else [])
    step = round(0.05 * SECOND)
    results = []
    for k in range(round(duration / 0.05)):
        for source, values in signals.items():
            part = slice(k * RATES[source] // 20, (k + 1) * RATES[source] // 20)
            offsets = times[source][part] - k * 0.05
            results += comparison.feed("shield", source, EPOCH + k * step, offsets, values[part])
    axes = compared(*((times[source], signals[source]) for source in ("field", "model")), frame=frame).axes
    assert len(results) == 5
    for column, axis in enumerate(axes):
        for name in ("field_peak", "field_crest_factor", "field_kurtosis"):
            live = [getattr(result, name)[column] for result in results]
            np.testing.assert_allclose(live, getattr(axes[axis].windows, name)[1:6], rtol=0.15, err_msg=name)
    assert all(result.field_kurtosis.min() > 6.0 for result in results)


def test_sums_of_a_window_in_pieces_are_those_of_numpy_and_scipy():
    values = np.random.default_rng(1).gamma(2.0, size=(1000, 3)) * [1.0, -3.0, 0.2]
    total, empty = WindowSums(3), WindowSums(3)
    for part in np.split(values, [1, 300, 301, 800]):
        total.add(part.T)
    np.testing.assert_allclose(rms(total.count, total.moments), np.sqrt(np.mean(values**2, axis=0)))
    np.testing.assert_array_equal(total.peak, np.abs(values).max(axis=0))
    expected = scipy.stats.kurtosis(values, axis=0, fisher=False)
    np.testing.assert_allclose(kurtosis(total.count, total.moments), expected)
    for statistic in (rms, kurtosis):
        assert np.isnan(statistic(empty.count, empty.moments)).all()


@settings(max_examples=15)
@given(data=st.data())
def test_the_interleaving_does_not_matter(data):
    queues = {source: list(blocks(source, 6.0, length=0.25)) for source in RATES}
    shuffled = []
    while any(queues.values()):
        # One signal may run ahead, as far as the patience goes.
        ahead = [
            s for s, q in queues.items() if q and q[0][1] <= min(o[0][1] for o in queues.values() if o) + 2 * SECOND
        ]
        shuffled.append(queues[data.draw(st.sampled_from(ahead))].pop(0))
    results = run(WindowedComparison(2.0), shuffled)
    assert starts(results)[-1] == 4.0
    np.testing.assert_allclose(results[-1].model_rms, offline_rms("model", 6.0, 2.0, 4.0), rtol=0.02)
    np.testing.assert_allclose(results[-1].field_rms, offline_rms("field", 6.0, 2.0, 4.0), rtol=0.02)


def test_one_sample_a_message_works():
    model, field = blocks("model", 6.0), blocks("field", 6.0, length=0.001)
    stream = sorted([*model, *field], key=lambda block: block[1])
    assert starts(run(WindowedComparison(2.0), stream)) == [2.0, 4.0]


def test_a_start_within_a_window_waits_for_the_filter_to_settle():
    assert starts(run(WindowedComparison(2.0), interleaved(8.0, start=0.7))) == [4.0, 6.0]


def test_a_rotating_sensor_is_compared_by_length():
    result = run(WindowedComparison(2.0, rotating=["shield"]), interleaved(4.0))[0]
    plain = run(WindowedComparison(2.0), interleaved(4.0))[0]
    length = np.hypot(*plain.field_rms[1:])
    np.testing.assert_allclose(result.field_rms, [plain.field_rms[0], length, length])


def test_a_missing_signal_is_reported_as_coverage_zero():
    for source, other in (("model", "field"), ("field", "model")):
        results = run(WindowedComparison(2.0), list(blocks(source, 12.0)))
        assert len(results) >= 3
        for result, edge in zip(results, starts(results), strict=True):
            alone = offline_rms(source, 12.0, 2.0, edge, RATES[source])  # in the band of its own rate
            np.testing.assert_allclose(getattr(result, f"{source}_rms"), alone, rtol=0.01)
            assert result.coverage == 0.0
            assert getattr(result, f"{source}_coverage") == 1.0
            assert np.isnan(getattr(result, f"{other}_rms")).all()
            if other == "field":
                assert np.isnan([result.field_peak, result.field_crest_factor, result.field_kurtosis]).all()
            assert np.isnan(result.relative_error).all()


def test_a_signal_that_ends_is_missing_from_then_on():
    stream = [block for block in interleaved(14.0) if block[0] == "model" or block[1] < EPOCH + 6 * SECOND]
    results = run(WindowedComparison(2.0), stream)
    assert [result.coverage for result in results][:3] == [1.0, 1.0, 0.0]
    assert np.isfinite(results[2].model_rms).all()


def test_lost_blocks_lower_the_coverage_and_little_else():
    kept = [b for b in interleaved(10.0) if b[0] == "model" or not 4.4 <= (b[1] - EPOCH) / SECOND < 4.9]
    comparison = WindowedComparison(2.0)
    results = run(comparison, kept)
    assert [result.field_coverage for result in results] == pytest.approx([1.0, 0.75, 1.0, 1.0])
    assert comparison.counters["shield"]["field"].gaps == 0
    for result, whole in zip(results, run(WindowedComparison(2.0), interleaved(10.0)), strict=True):
        np.testing.assert_allclose(result.field_rms, whole.field_rms, rtol=0.05)


def test_too_little_coverage_gives_no_error():
    kept = [b for b in interleaved(8.0) if b[0] == "model" or not 4.0 <= (b[1] - EPOCH) / SECOND < 5.5]
    errors = [np.isnan(result.relative_error).all() for result in run(WindowedComparison(2.0), kept)]
    assert errors == [False, True, False]


def test_a_long_gap_starts_the_filter_afresh():
    kept = [b for b in interleaved(20.0) if b[0] == "model" or not 6.0 <= (b[1] - EPOCH) / SECOND < 9.0]
    comparison = WindowedComparison(2.0)
    results = run(comparison, kept)
    assert comparison.counters["shield"]["field"].gaps == 1
    assert 8.0 not in starts(results)
    assert 10.0 not in starts(results)
    assert starts(results)[-4:] == [12.0, 14.0, 16.0, 18.0]


def test_a_bag_loop_starts_afresh_and_goes_on():
    comparison = WindowedComparison(2.0)
    first, second = run(comparison, interleaved(8.0)), run(comparison, interleaved(8.0))
    assert starts(first) == [2.0, 4.0, 6.0]
    assert starts(second)[-2:] == [4.0, 6.0]
    # The signal that jumps first restarts the point for both.
    assert [comparison.counters["shield"][source].restarts for source in RATES] == [1, 0]
    assert [comparison.counters["shield"][source].late for source in RATES] == [0, 0]


@pytest.mark.parametrize("who", ["field", "model"])
@pytest.mark.parametrize("away", [-1e9, -60.0, -3.0, -0.5, 0.5, 1.5, 3.0, 60.0, 1e8])
def test_a_second_publisher_with_other_stamps_changes_nothing(away, who):
    """A replay beside live sensors, a clock that was not set; beside losses, too."""
    stream = [b for b in interleaved(10.0) if not 4.4 <= (b[1] - EPOCH) / SECOND < 4.5]
    both, alone = WindowedComparison(2.0), WindowedComparison(2.0)
    strays = []
    for block in stream:
        strays.append(block)
        if block[0] == who:
            strays.append((who, block[1] + round(away * SECOND), *block[2:]))
    for found, expected in zip(run(both, strays), run(alone, stream), strict=True):
        assert vars(found).keys() == vars(expected).keys()
        for name, value in vars(expected).items():
            np.testing.assert_array_equal(getattr(found, name), value, err_msg=name)
    counters = both.counters["shield"][who]
    length = round(0.05 * RATES[who])
    assert counters.late == (len([b for b in stream if b[0] == who]) - 1) * length  # the last one still waits
    assert (counters.restarts, counters.gaps, counters.rate_changes) == (0, 0, 0)


def test_a_clock_that_was_set_is_followed():
    """All that came since is compared, once it has gone on for a window."""
    jumped = [(b[0], b[1] + (100 * SECOND if b[1] >= EPOCH + 6 * SECOND else 0), *b[2:]) for b in interleaved(16.0)]
    comparison = WindowedComparison(2.0)
    results = run(comparison, jumped)
    # The filter settles in the first window after a gap.
    assert [start for start, result in zip(starts(results), results, strict=True) if result.coverage == 1.0] == [
        *(2.0, 4.0),
        *(108.0, 110.0, 112.0, 114.0),
    ]
    assert [comparison.counters["shield"][source].late for source in RATES] == [0, 0]


def test_values_that_are_not_finite_are_rejected_and_counted():
    stream = interleaved(6.0)
    for source, _, _, values in stream[10:12]:
        assert source in RATES
        values[3] = np.nan
    comparison = WindowedComparison(2.0)
    results = run(comparison, stream)
    assert sum(c.rejected for c in comparison.counters["shield"].values()) == 2
    assert all(np.isfinite(result.relative_error).all() for result in results)


def test_samples_that_come_twice_are_counted_and_dropped():
    stream = interleaved(6.0)
    comparison = WindowedComparison(2.0)
    results = run(comparison, [block for block in stream for _ in range(2)])
    assert comparison.counters["shield"]["field"].late == 5950  # the last one still waits
    assert [result.coverage for result in results] == [1.0, 1.0]


def test_a_point_with_nothing_but_rejects_gives_nothing():
    comparison = WindowedComparison(2.0)
    assert comparison.feed("girder", "field", EPOCH, [0.0], [[np.inf, 0.0, 0.0]]) == []
    assert comparison.feed("girder", "field", EPOCH, [], np.empty((0, 3))) == []


def test_points_do_not_touch_each_other():
    comparison = WindowedComparison(2.0)
    stream = interleaved(6.0)
    both = [result for block in stream for point in ("shield", "gripper") for result in comparison.feed(point, *block)]
    assert [result.point for result in both] == ["shield", "gripper"] * 2


def test_memory_is_bounded_when_one_signal_is_missing():
    comparison = WindowedComparison(0.5)
    run(comparison, list(blocks("model", 20.0)))
    stream = comparison._points["shield"].streams["model"]
    assert len(stream.sums) < 5
    assert len(stream.queue) <= 0.6 * RATES["model"]


def test_a_chosen_band_needs_no_partner():
    results = run(WindowedComparison(2.0, high_hz=300.0), list(blocks("model", 10.0)))
    assert np.isfinite(results[-1].model_rms).all()


def test_bad_shapes_name_the_point():
    with pytest.raises(ValueError, match="test point shield"):
        WindowedComparison().feed("shield", "field", EPOCH, [0.0, 1.0], [[0.0, 0.0, 0.0]])
    with pytest.raises(ValueError, match="window_s"):
        WindowedComparison(0.0)


def window(error: list[float], point: str = "shield") -> WindowResult:
    """Window in which less was measured than computed, by this relative error."""
    level = np.ones(3)
    measured = level / (1.0 + np.array(error))
    return WindowResult(point, 0, 2 * SECOND, level, measured, np.array(error), 1.0, 1.0, 4 * level, 3 * level)


def times(*factors: float) -> WindowResult:
    """Window in which so many times the computed level was measured."""
    return window([1.0 / factor - 1.0 for factor in factors])


HIGH, LOW, UNKNOWN = [0.1, 0.4, 0.2], [0.1, 0.1, 0.1], [np.nan] * 3


def test_the_alarm_needs_consecutive_windows_and_comes_once():
    rule = AlarmRule(0.30, 3)
    assert [rule.update(window(e)) for e in [HIGH, HIGH, LOW, HIGH, HIGH, HIGH, HIGH]] == [False] * 5 + [True, False]
    assert rule.raised == {"shield"}
    assert not rule.update(window(LOW))
    assert rule.raised == frozenset()
    assert [rule.update(window(HIGH)) for _ in range(3)] == [False, False, True]


def test_an_unknown_error_neither_raises_nor_clears():
    rule = AlarmRule(0.30, 2)
    assert [rule.update(window(e)) for e in [HIGH, UNKNOWN, HIGH]] == [False, False, True]


def test_points_alarm_on_their_own():
    rule = AlarmRule(0.30, 2)
    rule.update(window(HIGH, "shield"))
    assert not rule.update(window(HIGH, "gripper"))


@pytest.mark.parametrize("baseline", [None, {"shield": UsualRatio(np.log([0.5] * 3), [0.02] * 3)}])
@pytest.mark.parametrize("factor", [1.5, 1000.0, 1.0 / 1.5, 0.02])
def test_growth_and_fall_count_alike_and_without_bound(baseline, factor):
    """The relative error would be bounded by 1 for whatever grows: a field 1.5 to 1 000 times larger was no alarm."""
    usual = 1.0 if baseline is None else 0.5
    rule = AlarmRule(0.30, 1, baseline)
    assert not rule.update(times(usual, usual, usual))
    assert not rule.update(times(1.29 * usual, usual / 1.29, usual))
    assert rule.update(times(usual, factor * usual, usual))


def test_a_baseline_that_makes_an_axis_blind_says_so():
    assert UsualRatio([0.0] * 3, [0.23, np.nan, 0.31]).blind == {"z": pytest.approx(np.exp(0.93))}


def test_a_change_within_the_scatter_of_the_baseline_is_none():
    rule = AlarmRule(0.10, 1, baseline={"shield": UsualRatio(np.log([0.7] * 3), [0.1, 0.01, 0.01])})
    assert not rule.update(times(0.7 * 1.3, 0.7, 0.7))  # within exp(3 · 0.1)
    assert rule.update(times(0.7 * 1.4, 0.7, 0.7))
    assert not rule.update(times(0.7, 0.7 / 1.08, 0.7))  # beyond the scatter, within the threshold
    assert rule.update(times(0.7, 0.7 / 1.15, 0.7))


def test_without_a_baseline_the_threshold_is_absolute():
    rule = AlarmRule(0.30, 1, baseline={"shield": UsualRatio(-np.log([1.9, np.nan, 1.9]), np.zeros(3))})
    assert not rule.update(window([0.9, 0.2, 0.9]))
    assert rule.update(window([0.9, 0.4, 0.9]))
    assert rule.update(window([0.9, 0.2, 0.9], "gripper"))


def test_the_alarm_may_watch_one_axis():
    assert not AlarmRule(0.30, 1, axes=(0,)).update(window(HIGH))


def test_a_dead_sensor_does_not_alarm():
    """Its error is as large as you like, and says nothing of the machine; the axes that live still count."""
    quiet = replace(window([np.inf, 400.0, 0.1]), field_rms=np.array([0.0, 0.0025, 1.0]))
    assert dead_axes(quiet).tolist() == [True, True, False]
    assert not AlarmRule(0.30, 1).update(quiet)
    louder = replace(quiet, relative_error=np.array([np.inf, 400.0, 0.4]), field_rms=np.array([0.0, 0.0025, 0.7]))
    assert AlarmRule(0.30, 1).update(louder)


def test_a_window_at_no_steady_level_does_not_alarm():
    rule = AlarmRule(0.30, 1)
    assert not rule.update(replace(window(HIGH), operation="standstill"))
    assert not rule.update(replace(window(HIGH), operation="transient"))
    assert rule.update(window(HIGH))


@pytest.mark.parametrize("wrong", [{"threshold": 0.0}, {"windows": 0}])
def test_rules_without_sense_are_refused(wrong):
    with pytest.raises(ValueError, match="threshold > 0 and windows >= 1"):
        AlarmRule(**wrong)
