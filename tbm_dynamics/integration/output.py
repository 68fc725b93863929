"""Outputs from the records of a block of steps: a matrix product for each group of columns that need the same rows."""

from __future__ import annotations

import numpy as np
from numba import njit


class Output:
    """A matrix from rows of a record to outputs, most of whose columns need only some of the record.

    Axial motion, for one, has nothing to do with the states of lateral motion. The products are always of the same
    size, so that a step gives the same bits in whatever pieces it is asked for.

    Parameters
    ----------
    matrix : (r, o) ndarray
    tail : int
        Last columns of the record, which any output may need.
    constant : (o,) ndarray
        Added to the outputs.
    steps : int
        Rows of a block.
    """

    def __init__(self, matrix: np.ndarray, tail: int, constant: np.ndarray, steps: int) -> None:
        rows = len(matrix) - tail
        needed = matrix[:rows] != 0.0
        first = np.where(needed.any(axis=0), needed.argmax(axis=0), 0)
        last = np.where(needed.any(axis=0), rows - needed[::-1].argmax(axis=0), 0)
        order = np.lexsort((last, first))
        borders = np.flatnonzero(np.diff(first[order]) | np.diff(last[order])) + 1
        self._groups = []
        for columns in np.split(np.arange(matrix.shape[1]), borders):
            span = slice(first[order[columns[0]]], last[order[columns[0]]])
            place = slice(columns[0], columns[-1] + 1)
            self._groups.append((span, place, np.ascontiguousarray(matrix[span, order[place]])))
        self._tail = slice(rows, len(matrix))
        self._from_tail = np.ascontiguousarray(matrix[rows:, order])
        self._constant, self._order = constant[order], order
        self._product, self._by_tail = np.empty((2, steps, matrix.shape[1]))

    def of(self, record: np.ndarray, rows: slice, out: np.ndarray) -> None:
        """Write the outputs of some rows of a block: record (steps, r) to out (rows, o)."""
        np.matmul(record[:, self._tail], self._from_tail, out=self._by_tail)
        for span, place, matrix in self._groups:
            np.matmul(record[:, span], matrix, out=self._product[:, place])
        _placed(self._product[rows], self._by_tail[rows], self._constant, self._order, out)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _placed(a: np.ndarray, b: np.ndarray, c: np.ndarray, order: np.ndarray, out: np.ndarray) -> None:
    """Write a + b (n, o) + c (o,) to the columns `order` of out."""
    for i in range(len(a)):
        for j in range(len(order)):
            out[i, order[j]] = a[i, j] + b[i, j] + c[j]
