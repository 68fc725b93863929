"""Arrays that begin on a cache line: vector loads across two of them cost the compiled steps a tenth of their time."""

from __future__ import annotations

import numpy as np

_LINE = 64


def empty(*shape: int) -> np.ndarray:
    """Uninitialised array of floats."""
    size = 8 * int(np.prod(shape))
    memory = np.empty(size + _LINE, dtype=np.uint8)
    start = -memory.ctypes.data % _LINE
    return memory[start : start + size].view(float).reshape(shape)


def zeros(*shape: int) -> np.ndarray:
    """Array of zeros."""
    found = empty(*shape)
    found[...] = 0.0
    return found


def copy(values: np.ndarray) -> np.ndarray:
    """Copy of an array of floats."""
    found = empty(*values.shape)
    found[...] = values
    return found
