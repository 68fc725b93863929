"""Slow, anti-aliased copies of fast signals for live display."""

from __future__ import annotations

import numpy as np
import scipy.signal

_ORDER = 6
_CORNER = 0.4
"""Corner of the low-pass over the slow rate."""


class LiveFilter:
    """Low-pass and every `stride`-th sample, causal, in any chunks.

    Parameters
    ----------
    rate_hz : float
        Of the input.
    stride : int
        Input samples per output sample.
    """

    def __init__(self, rate_hz: float, stride: int) -> None:
        self._stride = stride
        self._sos = (
            scipy.signal.butter(_ORDER, _CORNER * rate_hz / stride, fs=rate_hz, output="sos") if stride > 1 else None
        )
        self._state: np.ndarray | None = None

    def process(self, first_step: int, values: np.ndarray) -> list[tuple[int, np.ndarray]]:
        """Filter consecutive samples (n, c); return (step, sample (c,)) at every multiple of the stride."""
        if self._sos is not None:
            if self._state is None:
                # Starts as if the first sample had always been there.
                self._state = scipy.signal.sosfilt_zi(self._sos)[:, :, None] * values[0]
            values, self._state = scipy.signal.sosfilt(self._sos, values, axis=0, zi=self._state)
        first = -first_step % self._stride
        return [(first_step + i, values[i]) for i in range(first, len(values), self._stride)]
