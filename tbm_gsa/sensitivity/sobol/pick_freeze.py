"""Saltelli's pick-freeze design, and a function's values on it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import qmc

from tbm_gsa.sensitivity.sobol.indices import Groups, checked_groups
from tbm_gsa.sensitivity.surrogates.samples import checked_bounds
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError


@dataclass(frozen=True, eq=False)
class PickFreezeDesign:
    """Two matrices A, B of points, and the exchanges of columns between them.

    The points are those of ``SALib.sample.sobol`` (scrambled Sobol' sequence); they are handed out one block of N at a
    time, so that memory grows with N and not with N (g + 2).

    Parameters
    ----------
    base, other : ndarray, shape (N, d)
        A and B.
    groups : tuple of tuple of int
        Columns that are exchanged together.
    """

    base: Array
    other: Array
    groups: tuple[tuple[int, ...], ...]

    @classmethod
    def draw(cls, bounds: ArrayLike, samples: int, seed: int, groups: Groups | None = None) -> "PickFreezeDesign":
        """Draw a design of base size N, a power of two, inside bounds (d, 2)."""
        box = checked_bounds(bounds)
        if samples < 2 or samples & (samples - 1):
            raise InputError(f"{samples} samples, allowed: a power of two, as Sobol' sequences need it")
        inputs = len(box)
        sequence = qmc.Sobol(d=2 * inputs, scramble=True, seed=seed).random(samples)
        points = box[:, 0] + sequence.reshape(samples, 2, inputs) * (box[:, 1] - box[:, 0])
        return cls(points[:, 0], points[:, 1], checked_groups(groups, inputs))

    def exchanged(self) -> Iterator[Array]:
        """Return A with the columns of one group from B, (N, d), group after group."""
        return (_exchange(self.base, self.other, group) for group in self.groups)

    def exchanged_back(self) -> Iterator[Array]:
        """Return B with the columns of one group from A."""
        return (_exchange(self.other, self.base, group) for group in self.groups)


def _exchange(into: Array, source: Array, columns: tuple[int, ...]) -> Array:
    """Copy of `into` with some columns of `source`."""
    points = into.copy()
    points[:, list(columns)] = source[:, list(columns)]
    return points


@dataclass(frozen=True, eq=False)
class DesignValues:
    """Values of a function on a design, standardised by their common mean and deviation, as SALib does.

    Parameters
    ----------
    a, b : ndarray, shape (N,)
    mixed : ndarray, shape (g, N)
        On A with one group from B.
    back : ndarray, shape (g, N), or None
        On B with one group from A; second-order indices need it.
    mean, spread : float
        What they were standardised by.
    """

    a: Array
    b: Array
    mixed: Array
    back: Array | None
    mean: float
    spread: float

    @classmethod
    def of(
        cls, function: Callable[[Array], Array], design: PickFreezeDesign, *, second: bool = False
    ) -> "DesignValues":
        """Evaluate a function (n, d) → (n,) on a design."""
        a, b = _checked(function, design.base), _checked(function, design.other)
        mixed = np.stack([_checked(function, points) for points in design.exchanged()])
        back = np.stack([_checked(function, points) for points in design.exchanged_back()]) if second else None
        return cls._standardised(a, b, mixed, back)

    def prefix(self, samples: int) -> "DesignValues":
        """Keep the first N points, by themselves a design of that size."""
        back = None if self.back is None else self.back[:, :samples]
        return self._standardised(self.a[:samples], self.b[:samples], self.mixed[:, :samples], back, self)

    @classmethod
    def _standardised(
        cls, a: Array, b: Array, mixed: Array, back: Array | None, before: "DesignValues | None" = None
    ) -> "DesignValues":
        """Standardise, on top of what was done before."""
        everything = np.concatenate([a, b, *mixed, *([] if back is None else back)])
        mean, spread = float(everything.mean()), float(everything.std())
        if spread <= 1e-12 * abs(mean) or spread == 0.0:
            raise InputError(f"the function is constant ({mean:g}), allowed: one with a variance to explain")
        a, b, mixed = ((values - mean) / spread for values in (a, b, mixed))
        back = None if back is None else (back - mean) / spread
        if before is not None:
            mean, spread = before.mean + before.spread * mean, before.spread * spread
        return cls(a, b, mixed, back, mean, spread)

    @property
    def evaluations(self) -> int:
        """Points the function was evaluated at."""
        blocks = 2 + len(self.mixed) + (0 if self.back is None else len(self.back))
        return blocks * len(self.a)


def _checked(function: Callable[[Array], Array], points: Array) -> Array:
    """Values (n,) of the function, checked."""
    values = np.asarray(function(points), dtype=float)
    if values.shape != (len(points),):
        raise InputError(f"the function's values have shape {values.shape}, allowed: ({len(points)},), one a point")
    if not np.isfinite(values).all():
        raise InputError("the function returned a value that is not finite, allowed: finite ones")
    return values
