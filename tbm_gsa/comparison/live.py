"""Model against field while both arrive: absolute windows of a few seconds, per test point.

Blocks of both signals come in any interleaving and are brought together by their stamps. Only sums per window are
kept, never samples, so the memory does not grow.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tbm_gsa.comparison.rate import StreamCounters
from tbm_gsa.comparison.results import OperatingKind
from tbm_gsa.comparison.streams import SIDES, LiveWindow, PointStreams, Side
from tbm_gsa.signals.spans import SpanCollector, SpanSpectrum
from tbm_gsa.signals.statistics import kurtosis, ratio, relative_error, rms
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.units import NANOSECONDS

LARGEST = 1e6  # m/s²: nothing that is bolted to a machine measures more, and a filter would not get over it


@dataclass(frozen=True, eq=False)
class WindowResult:
    """Comparison of one window at one test point.

    Attributes
    ----------
    point : str
        Test point.
    start_ns, length_ns : int
        The window; starts are multiples of the length.
    model_rms, field_rms : ndarray, shape (3,)
        m/s²; NaN if that signal is missing. Of a rotating sensor, y and z both hold √(y² + z²).
    relative_error : ndarray, shape (3,)
        Equation (4); NaN where the coverage is too low to say.
    model_coverage, field_coverage : float
        Share of the window that really arrived, 0 … 1.
    field_peak : ndarray, shape (3,)
        Largest magnitude, m/s²; y and z of a rotating sensor as above.
    field_kurtosis : ndarray, shape (3,)
        3 of Gaussian noise; bearings and gears that begin to fail raise it first.
    operation : {"steady", "transient", "standstill"}
        How the machine was driven; only a steady window can be compared.
    """

    point: str
    start_ns: int
    length_ns: int
    model_rms: Array
    field_rms: Array
    relative_error: Array
    model_coverage: float
    field_coverage: float
    field_peak: Array
    field_kurtosis: Array
    operation: OperatingKind = "steady"

    @property
    def coverage(self) -> float:
        """Share of the window that both signals cover at best."""
        return min(self.model_coverage, self.field_coverage)

    @property
    def log_ratio(self) -> Array:
        """Logarithm of the measured over the computed RMS, (3,); not finite where one is missing or zero."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(self.field_rms) - np.log(self.model_rms))

    @property
    def field_crest_factor(self) -> Array:
        """Peak over RMS, (3,)."""
        return ratio(self.field_peak, self.field_rms)


class WindowedComparison:
    """Compares model and field window by window at every test point that is fed.

    Parameters
    ----------
    window_s : float
        Length of a window.
    rotating : iterable of str
        Test points whose sensor turns with the head: y and z are compared as √(y² + z²).
    high_hz : float or None
        Upper limit of the band; by default what `common_band` gives for the two rates.
    patience : int
        Windows that one signal may lag behind before a window is closed without it.
    least_coverage : float
        Below it a window gives no error.
    span_s : float
        Length of the spans of the field's spectra.
    """

    def __init__(
        self,
        window_s: float = 2.0,
        *,
        rotating: Iterable[str] = (),
        high_hz: float | None = None,
        patience: int = 2,
        least_coverage: float = 0.5,
        span_s: float = 60.0,
    ) -> None:
        if not window_s > 0.0:
            raise InputError(f"window_s must be positive, not {window_s}")
        self.counters: dict[str, dict[Side, StreamCounters]] = {}
        self._window_ns = round(window_s * NANOSECONDS)
        self._rotating, self._high_hz, self._patience = frozenset(rotating), high_hz, patience
        self._least_coverage = least_coverage
        self._points: dict[str, PointStreams] = {}
        self._span_ns = round(span_s * NANOSECONDS)
        self._spans: dict[str, SpanCollector] = {}

    def feed(self, point: str, source: Side, stamp_ns: int, t: ArrayLike, values: ArrayLike) -> list[WindowResult]:
        """Windows that a block completes.

        Parameters
        ----------
        point : str
            Test point.
        source : {"model", "field"}
            Which signal.
        stamp_ns : int
            Stamp of the block, ns since the epoch.
        t : array_like, shape (n,)
            Times after the stamp, s.
        values : array_like, shape (n, 3)
            m/s², in the machine axes; samples that are not finite, or beyond `LARGEST`, count as rejected.

        Returns
        -------
        list of WindowResult
            In the order of time. Windows in which a filter was still settling are left out.
        """
        offsets, rows = np.asarray(t, dtype=np.float64), np.asarray(values, dtype=np.float64)
        if offsets.ndim != 1 or rows.shape != (offsets.size, 3):
            raise InputError(
                f"test point {point}: t and values must be (n,) and (n, 3), not {offsets.shape} and {rows.shape}"
            )
        counters = self.counters.setdefault(point, {name: StreamCounters() for name in SIDES})
        finite = np.isfinite(offsets) & (np.abs(rows) <= LARGEST).all(axis=1)
        counters[source].rejected += int(np.count_nonzero(~finite))
        times = stamp_ns + np.rint(offsets[finite] * NANOSECONDS).astype(np.int64)
        if not times.size:
            return []
        if point not in self._points:
            self._points[point] = PointStreams(
                self._window_ns,
                counters,
                rotating=point in self._rotating,
                high_hz=self._high_hz,
                patience=self._patience,
                spans=self._spans.setdefault(point, SpanCollector(self._span_ns)),
            )
        windows = self._points[point].feed(source, times, rows[finite])
        return [self._result(point, index, sums) for index, sums in windows]

    def pop_spans(self) -> dict[str, list[SpanSpectrum]]:
        """Remove and return the spectra of the field's spans that are over, by test point."""
        found = {point: collector.pop() for point, collector in self._spans.items()}
        return {point: spans for point, spans in found.items() if spans}

    def apart_ns(self) -> dict[str, int]:
        """How far the model's stamps are ahead of the field's, ns, at the points where no window can hold both."""
        ahead: dict[str, int] = {}
        for point, both in self._points.items():
            model, field = (both.streams[source].queue.latest_ns for source in SIDES)
            if model is not None and field is not None:
                ahead[point] = model - field
        return {point: ns for point, ns in ahead.items() if abs(ns) > (self._patience + 1) * self._window_ns}

    def latest_ns(self) -> int | None:
        """Latest stamp of any signal, ns; None before the first sample."""
        streams = (stream for both in self._points.values() for stream in both.streams.values())
        return max((stream.queue.latest_ns for stream in streams if stream.queue.latest_ns is not None), default=None)

    def restart(self, point: str) -> None:
        """Begin a point anew: its signals come from elsewhere now, at another rate perhaps."""
        self._points.pop(point, None)

    def _result(self, point: str, index: int, sums: Mapping[Side, LiveWindow]) -> WindowResult:
        length_ns, (model, field) = self._window_ns, (sums[source] for source in SIDES)
        shares = model.coverage(length_ns), field.coverage(length_ns)
        model_rms, field_rms = (rms(side.count, side.moments) for side in (model, field))
        error = relative_error(field_rms, model_rms) if min(shares) >= self._least_coverage else np.full(3, np.nan)
        return WindowResult(
            point=point,
            start_ns=index * length_ns,
            length_ns=length_ns,
            model_rms=model_rms,
            field_rms=field_rms,
            relative_error=error,
            model_coverage=shares[0],
            field_coverage=shares[1],
            field_peak=field.peak if field.count else np.full(3, np.nan),
            field_kurtosis=kurtosis(field.count, field.moments),
        )
