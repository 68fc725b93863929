"""The one causal filter: over a signal that comes in pieces, with results that do not depend on them."""

from __future__ import annotations

import scipy  # its parts are loaded on first use: commands and nodes that do not filter wait for none

from tbm_msgs_py.base.arrays import Array


class CausalFilter:
    """Filter of several channels whose state is carried from piece to piece.

    Parameters
    ----------
    sections : ndarray (k, 6)
        Second-order sections, as `scipy.signal.butter` returns them.
    """

    def __init__(self, sections: Array) -> None:
        self._sections = sections
        self._steady: Array = scipy.signal.sosfilt_zi(sections)[:, :, None]
        self._state: Array | None = None

    def reset(self) -> None:
        """Drop the state: the next values begin a new signal."""
        self._state = None

    def process(self, values: Array, start: Array | None = None) -> Array:
        """Filter the next values (n, c).

        A signal begins as if `start` (c,), by default its first value, had always been there.
        """
        if not len(values):
            return values
        if self._state is None:
            self._state = self._steady * (values[0] if start is None else start)
        filtered: Array
        filtered, self._state = scipy.signal.sosfilt(self._sections, values, axis=0, zi=self._state)
        return filtered
