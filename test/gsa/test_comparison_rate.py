"""A sensor whose rate is another than its stamps declare, or changes; and what is none of it."""

from collections.abc import Iterator

import numpy as np
import pytest

from tbm_gsa.app.nodes.stream_health import StreamHealth
from tbm_gsa.comparison import WindowedComparison, WindowResult

SECOND = 1_000_000_000
WINDOW = 2.0
EPOCH = 1_700_000_000 * SECOND  # a multiple of the window
MODEL_HZ = 5000
FAULT, OVER, END = 6.6, 14.6, 24.0  # s
DECLARED = "gaps between the blocks of the field: 10000 Hz declared, 5000 Hz came"

Block = tuple[str, float, np.ndarray, np.ndarray]  # source, time of the stamp in s, offsets, values


def signal(times: np.ndarray) -> np.ndarray:
    """Two tones a direction that every sampling sees, (n, 3), and gravity."""
    tones = [np.sin(2.0 * np.pi * frequency * times) for frequency in (37.0, 113.0, 210.0)]
    return 3.0 * np.transpose(tones) + [0.0, 0.0, 9.81]


def blocks(source: str, rate: float, begin: float = 0.0, end: float = END, length: float = 0.05) -> Iterator[Block]:
    offsets = np.arange(round(length * rate)) / rate
    for stamp in np.arange(round(begin / length), round(end / length)) * length:
        yield source, stamp, offsets, signal(stamp + offsets)


def squeezed(rate: float, begin: float, end: float) -> Iterator[Block]:
    """Sensor that declares half the spacing it samples with."""
    for source, stamp, offsets, values in blocks("field", rate, begin, end):
        yield source, stamp, offsets / 2.0, values


def jittered(stream: Iterator[Block], seconds: float, seed: int = 1) -> list[Block]:
    rng = np.random.default_rng(seed)
    return [(source, stamp + rng.normal(0.0, seconds), *rest) for source, stamp, *rest in stream]


class Run:
    """What a comparison and the diagnostics say, the latter by the stream's time, once a second."""

    def __init__(self, field: list[Block], model_hz: float = MODEL_HZ) -> None:
        self.comparison = WindowedComparison(WINDOW)
        self.results: list[WindowResult] = []
        self.doubts: dict[float, list[str]] = {}
        health = StreamHealth(lambda _: None)
        look = 1.0
        both = [*blocks("model", model_hz), *field]
        for source, stamp, offsets, values in sorted(both, key=lambda block: block[1]):
            if stamp >= look:
                found = health.conditions(self.comparison.counters, True, self.comparison.apart_ns())
                self.doubts[look] = [text for condition in found.values() for text in condition.doubts]
                look += 1.0
            self.results += self.comparison.feed("shield", source, EPOCH + round(stamp * SECOND), offsets, values)

    @property
    def counters(self):
        return self.comparison.counters["shield"]["field"]

    def told(self, text: str) -> list[float]:
        """Times at which a text was on the diagnostics."""
        return [look for look, texts in self.doubts.items() if any(text in one for one in texts)]

    def window(self, start: float) -> WindowResult | None:
        at = EPOCH + round(start * SECOND)
        return next((result for result in self.results if result.start_ns == at), None)


def test_half_the_spacing_declared_from_the_beginning():
    run = Run(list(squeezed(5000, 0.0, END)))
    assert run.told("40 " + DECLARED) == [float(look) for look in range(3, 24)]
    assert run.counters.rate_changes == 0
    assert [result.field_coverage for result in run.results] == pytest.approx([0.5] * 10)
    assert (run.counters.declared_hz, run.counters.came_hz) == pytest.approx((10_000, 5000), rel=1e-6)


def test_half_the_spacing_declared_for_a_while():
    field = [*blocks("field", 5000, 0.0, FAULT), *squeezed(5000, FAULT, OVER), *blocks("field", 5000, OVER)]
    run = Run(field)
    told = run.told(DECLARED)
    assert told == [float(look) for look in range(int(told[0]), int(OVER) + 2)]  # without a break, gone at once
    assert told[0] <= 10.0  # the end of the window after the one it begins in
    # Once when it is found, once when it is over.
    assert run.told("1 changes of the rate of the field: 10000 Hz now") == [7.0, 8.0]
    assert run.told("1 changes of the rate of the field: 5000 Hz now") == [15.0, 16.0]
    shares = {(result.start_ns - EPOCH) / SECOND: result.field_coverage for result in run.results}
    whole, half = dict.fromkeys((2.0, 4.0, 18.0, 20.0, 22.0), 1.0), dict.fromkeys((10.0, 12.0), 0.5)
    assert shares == pytest.approx(whole | half, abs=1e-6)


@pytest.mark.parametrize(("before", "after"), [(5000, 10_000), (10_000, 5000), (2000, 1000), (1000, 2000), (5000, 800)])
def test_a_rate_that_changes_starts_the_filter_afresh(before, after):
    run = Run([*blocks("field", before, 0.0, FAULT), *blocks("field", after, FAULT)])
    told = run.told(f"1 changes of the rate of the field: {after} Hz now")
    assert run.told("changes of the rate") == told
    assert told in ([7.0, 8.0], [8.0, 9.0])  # in the window in which it changes, and once more
    assert run.told("gaps") == []
    assert (run.window(6.0), run.window(8.0)) == (None, None)  # the one it happens in, and the filter settles
    fresh = Run(list(blocks("field", after)))
    for start in (12.0, 18.0):
        found, wanted = run.window(start), fresh.window(start)
        np.testing.assert_allclose(found.field_rms, wanted.field_rms, rtol=1e-3)
        np.testing.assert_allclose(found.model_rms, wanted.model_rms, rtol=1e-3)  # in the same band
        assert found.coverage == 1.0


@pytest.mark.parametrize(("before", "after", "at"), [(5000, 10_000, 7.8), (10_000, 5000, 7.9)])
def test_a_window_in_which_the_rate_changes_is_left_out(before, after, at):
    run = Run([*blocks("field", before, 0.0, at), *blocks("field", after, at)])
    assert run.window(4.0) is not None
    assert run.window(6.0) is None


def test_single_samples_that_change_their_rate_are_seen():
    run = Run([*blocks("field", 1000, 0.0, FAULT, 1e-3), *blocks("field", 500, FAULT, END, 2e-3)])
    assert run.told("1 changes of the rate of the field: 500 Hz now") == [8.0, 9.0]
    assert run.window(12.0).coverage == 1.0


def every(stream: Iterator[Block], number: int) -> list[Block]:
    """Lose every so many blocks one."""
    return [block for place, block in enumerate(stream) if place % number != number // 2]


def off(share: float, length: float = 0.05, end: float = END) -> list[Block]:
    """Sensor whose blocks come faster or slower than its offsets say."""
    return [
        (source, stamp * share, offsets, values)
        for source, stamp, offsets, values in blocks("field", 5000, 0.0, end / share, length)
    ]


# Of single samples and of small blocks less is enough: each is handed over by itself.
SHORT = 15.0
SOUND = {
    "single samples jitter by 40 %": lambda: jittered(blocks("field", 1000, end=SHORT, length=1e-3), 0.4e-3),
    "single samples of 100 Hz jitter by 20 %": lambda: jittered(blocks("field", 100, length=1e-2), 2e-3),
    "stamps of blocks jitter by 1 ms": lambda: jittered(blocks("field", 5000), 1e-3),
    "stamps of small blocks jitter by 1 ms": lambda: jittered(blocks("field", 5000, end=SHORT, length=5e-3), 1e-3),
    "2 % slower": lambda: off(1.02),
    "2 % faster": lambda: off(0.98),
    "2 % slower with jitter": lambda: jittered(off(1.02), 1e-3),
    "small blocks 2 % slower with jitter": lambda: jittered(off(1.02, 5e-3, SHORT), 1e-3),
    "a block lost in nine": lambda: every(blocks("field", 5000), 9),
    "a block of a second lost in five": lambda: every(blocks("field", 5000, length=1.0), 5),
    "a block of two seconds lost in five": lambda: every(blocks("field", 5000, length=2.0), 5),
    "a silence": lambda: [block for block in blocks("field", 5000) if not FAULT < block[1] < OVER],
    "a slow clock": lambda: list(blocks("field", 4900)),
}


@pytest.mark.parametrize("case", SOUND)
def test_what_is_no_other_rate(case):
    run = Run(SOUND[case]())
    assert run.told("changes of the rate") == run.told("gaps between") == []
    assert len(run.results) >= 5


def test_two_publishers_of_one_sensor_are_no_other_rate():
    first = list(blocks("field", 5000))
    run = Run([*first, *((source, stamp + 0.02, *rest) for source, stamp, *rest in first)])
    assert run.told("changes of the rate") == run.told("gaps between") == []
    assert run.told("late or twice")
