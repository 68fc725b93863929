"""Slow, anti-aliased copies of fast signals for live display."""

from __future__ import annotations

import numpy as np
import scipy.signal

from tbm_msgs_py.base.causal_filter import CausalFilter

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
        self._filter: CausalFilter | None = None
        if stride > 1:
            corner = _CORNER * rate_hz / stride
            self._filter = CausalFilter(scipy.signal.butter(_ORDER, corner, fs=rate_hz, output="sos"))

    def process(self, first_step: int, values: np.ndarray) -> list[tuple[int, np.ndarray]]:
        """Filter consecutive samples (n, c); return (step, sample (c,)) at every multiple of the stride."""
        if self._filter is not None:
            values = self._filter.process(values)
        first = -first_step % self._stride
        return [(first_step + i, values[i]) for i in range(first, len(values), self._stride)]
