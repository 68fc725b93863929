"""The one causal filter: second-order sections whose state is carried from call to call."""

from __future__ import annotations

import numpy as np
import scipy.signal
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class CausalFilter:
    """Filters samples of several channels, the same bits in any chunks.

    It starts as if its first value had always been there.

    Parameters
    ----------
    sections : (k, 6) ndarray
        Second-order sections, as scipy.signal designs them.
    """

    def __init__(self, sections: FloatArray) -> None:
        self._sections = sections
        self._steady = scipy.signal.sosfilt_zi(sections)[:, :, None]
        self._state: FloatArray | None = None

    def reset(self) -> None:
        """Forget the state."""
        self._state = None

    def process(self, values: FloatArray, first: FloatArray | None = None) -> FloatArray:
        """Filter the next samples (n, c); `first` (c,) stands for the first value where the filter starts."""
        if not len(values):
            return values
        if self._state is None:
            self._state = self._steady * (values[0] if first is None else first)
        filtered: FloatArray
        filtered, self._state = scipy.signal.sosfilt(self._sections, values, axis=0, zi=self._state)
        return filtered
