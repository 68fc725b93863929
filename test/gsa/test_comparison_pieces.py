"""A recording reduced piece by piece: whatever the pieces, the numbers of one pass over the whole."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tbm_gsa.comparison.field_side import reduce_field
from tbm_gsa.signals.estimates import estimate
from tbm_gsa.signals.settings import Settings
from tbm_msgs_py.recordings.acceleration import AccelerationRecord
from tbm_msgs_py.recordings.faults import Clock, FaultCounts, find_gaps, stuck_axes

RATE, START_NS = 1000.0, 1_700_000_000_000_000_000
CHOSEN = Settings(bands=((0.5, 20.0), (100.0, 110.0)))
TIME = np.arange(150_000) / RATE
KEPT = (TIME < 47.3) | (TIME >= 48.0)
VALUES = np.random.default_rng(2).standard_normal((150_000, 3)) + np.array([0.0, 0.0, 9.81])
VALUES[60_000:65_000, 1] = 0.25  # stuck for 5 s


class Reader:
    """Pieces as `open_recording` gives them, cut where the test says."""

    def __init__(self, cuts):
        self.sensors = {"shield": SimpleNamespace(frame="fixed")}
        self.faults, self.clocks = {"shield": FaultCounts()}, {}
        self._cuts = cuts

    def pieces(self):
        time, values, before = TIME[KEPT], VALUES[KEPT], None
        for stamps, rows in zip(np.split(time, self._cuts), np.split(values, self._cuts), strict=True):
            if not stamps.size:
                continue
            start = round(stamps[0] * 1e9)
            own = stamps - stamps[0]
            gaps, rate = find_gaps(own, None if before is None else before - stamps[0])
            stuck = tuple(("xyz"[axis], a, b) for axis, a, b in stuck_axes(own, rows, RATE))
            before = float(stamps[-1])
            yield {
                "shield": AccelerationRecord(
                    "/t", "shield", START_NS + start, own, rows, gaps, rate, clipped=1, stuck=stuck, clock=Clock(0.5)
                )
            }


def reduced(cuts):
    side = reduce_field(Reader(cuts), ["shield"], CHOSEN)
    assert side.failed == {}
    return side


@pytest.fixture(scope="module")
def whole():
    side = reduced([])
    return side, estimate(side.signals["shield"], {0: 1.0}, CHOSEN)


@settings(max_examples=8)
@example(cuts=[358, 1623])  # a sampling rate from few stamps, a trifle beside that from all
@given(cuts=st.lists(st.integers(1, 149_000), max_size=6).map(sorted))
def test_statistics_do_not_depend_on_the_pieces(whole, cuts):
    expected = whole[1]
    signal = reduced(cuts).signals["shield"]
    found = estimate(signal, {0: 1.0}, CHOSEN)
    for axis, statistics in found.items():
        for name, value in statistics.values.items():
            rel = 1e-6 if name in {"rms", "peak", "crest_factor", "kurtosis"} else 1e-5
            assert value == pytest.approx(expected[axis].values[name], rel=rel), (axis, name)
        assert statistics.intervals["rms"] == pytest.approx(expected[axis].intervals["rms"], rel=1e-6)
        np.testing.assert_allclose(statistics.spectrum.density, expected[axis].spectrum.density, rtol=1e-5, atol=1e-9)
        assert statistics.spectrum.segments == expected[axis].spectrum.segments


@settings(max_examples=20)
@given(cuts=st.lists(st.integers(1, 149_000), max_size=4, unique=True).map(sorted))
def test_gaps_are_found_once_wherever_the_pieces_end(cuts):
    health = reduced(cuts).health["shield"]
    (gap,) = health.gaps
    assert gap == pytest.approx((47.299, 48.0))
    assert health.samples == KEPT.sum()
    assert health.duration == pytest.approx(149.999)
    assert health.clipped == len(cuts) + 1
    assert health.clock_offset == pytest.approx(0.5)


def test_a_stuck_axis_is_one_stretch_across_pieces():
    assert reduced([]).health["shield"].stuck == [("y", 60.0, 64.999)]
    cut = int(KEPT[:62_000].sum())
    ((axis, begin, end),) = reduced([cut]).health["shield"].stuck
    assert (axis, begin, end) == ("y", pytest.approx(60.0), pytest.approx(64.999))


def test_a_sensor_that_changes_its_rate_is_named():
    class Changing(Reader):
        def pieces(self):
            first, second = super().pieces()
            fast = second["shield"]
            yield first
            yield {"shield": AccelerationRecord("/t", "shield", fast.start_ns, fast.time / 2, fast.values, [], 2000.0)}

    side = reduce_field(Changing([75_000]), ["shield"], CHOSEN)
    assert side.signals == {}
    assert side.failed == {"shield": "sampling rate 1000 Hz does not fit the stamps, which say 2000 Hz"}
