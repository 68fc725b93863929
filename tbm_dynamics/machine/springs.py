"""What a connection resists with: springs and dampers in six directions, alone or coupled."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import AfterValidator, FiniteFloat, model_validator

from tbm_msgs_py.base.fields import NonNegative, Source, SparseModel

SixStiffnesses = tuple[NonNegative, NonNegative, NonNegative, NonNegative, NonNegative, NonNegative]
ConnectionType = Literal["rock", "bolt", "bearing", "spline", "hydraulic", "steel", "other"]

_Row = tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat]
_Rows = tuple[_Row, _Row, _Row, _Row, _Row, _Row]
_NONE: SixStiffnesses = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_ROUNDING = 1e-9  # of the largest entry: numbers of a file are rounded


def _passive(rows: _Rows) -> _Rows:
    """Matrix that is symmetric and gives no energy."""
    matrix = np.array(rows)
    least = -_ROUNDING * np.abs(matrix).max()
    # Forces and moments compare once each row is scaled by its own diagonal.
    scale = np.sqrt(np.where(matrix.diagonal() > 0.0, matrix.diagonal(), 1.0))
    if not np.allclose(matrix, matrix.T, rtol=_ROUNDING, atol=0.0):
        raise ValueError("must be symmetric")
    if matrix.diagonal().min() < least or np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min() < -_ROUNDING:
        raise ValueError("must not be negative: no motion may gain energy from it")
    return rows


Matrix6 = Annotated[_Rows, AfterValidator(_passive)]
"""Symmetric and positive semidefinite, 6 × 6."""


class Springs(SparseModel):
    """Stiffness and damping along and about three axes; the damping is that of the type, unless it is stated.

    Attributes
    ----------
    type : str
        Its ratio in `connection_damping` or of steel; `other` has none.
    stiffness : six numbers
        N/m and N·m/rad.
    stiffness_matrix : six rows of six numbers, optional
        Beside them, where directions are coupled.
    damping : six numbers, optional
        N·s/m and N·m·s/rad; with it or the matrix that of the type does not count.
    damping_matrix : six rows of six numbers, optional
    """

    optional: ClassVar[tuple[str, ...]] = ("stiffness_matrix", "damping", "damping_matrix")

    type: ConnectionType
    stiffness: SixStiffnesses = _NONE
    stiffness_matrix: Matrix6 | None = None
    damping: SixStiffnesses | None = None
    damping_matrix: Matrix6 | None = None
    source: Source

    @model_validator(mode="after")
    def _resists(self) -> Self:
        if not (self.stiffness_rows.any() or self.damps):
            raise ValueError("no stiffness and no damping, allowed: stiffness, stiffness_matrix, damping, …_matrix")
        return self

    @property
    def damps(self) -> bool:
        """Whether damping of its own is stated."""
        return self.damping is not None or self.damping_matrix is not None

    @property
    def stiffness_rows(self) -> np.ndarray:
        """Stiffness, (6, 6)."""
        return _sum(self.stiffness, self.stiffness_matrix)

    @property
    def damping_rows(self) -> np.ndarray:
        """Stated damping, (6, 6)."""
        return _sum(self.damping or _NONE, self.damping_matrix)


def _sum(six: SixStiffnesses, rows: _Rows | None) -> np.ndarray:
    return np.diag(six) + (0.0 if rows is None else np.array(rows))
