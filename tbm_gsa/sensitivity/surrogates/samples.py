"""What a surrogate is trained on: checked, scaled to the unit cube, transformed, standardised."""

from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tbm_gsa.sensitivity.surrogates.realisations import RealisationEffects
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError

Transform: TypeAlias = Literal["none", "log"]
TRANSFORMS: Final[tuple[Transform, ...]] = ("none", "log")
MINIMUM_SAMPLES = 10
# Points are called outside only beyond this share of the range: a design written and read back is off by rounding.
OUTSIDE_TOLERANCE = 1e-9
# Outputs whose spread is below this share of their size differ by rounding only.
CONSTANT_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """A design and one output.

    Parameters
    ----------
    X : ndarray, shape (n, d)
        Inputs in their own units.
    y : ndarray, shape (n,)
        Output in its own unit.
    bounds : ndarray, shape (d, 2)
        Lower and upper bound of every input.
    transform : {"none", "log"}
        What the output goes through before anything is fitted to it: a positive output whose inputs act as factors,
        as peaks do, is a sum on its logarithm, and its largest values no longer rule the fit.
    effects : RealisationEffects or None
        Of the loads' realisations that samples share; they are taken off the transformed output. None where there is
        one realisation, or none.
    """

    X: Array
    y: Array
    bounds: Array
    transform: Transform = "none"
    effects: RealisationEffects | None = None

    @property
    def unit(self) -> Array:
        """Inputs scaled to the unit cube by the bounds, (n, d)."""
        return to_unit(self.X, self.bounds)

    @property
    def transformed(self) -> Array:
        """Transformed output without the effects of realisations, (n,)."""
        values = self.transformed_of(self.y)
        return values if self.effects is None else values - self.effects.on(self.effects.labels)

    @property
    def adjusted(self) -> Array:
        """Output without the effects of realisations, in its own unit, (n,)."""
        return self.y if self.effects is None else self._inverse(self.transformed)

    @property
    def mean(self) -> float:
        """Mean of the transformed output."""
        return float(self.transformed.mean())

    @property
    def spread(self) -> float:
        """Standard deviation of the transformed output."""
        return float(self.transformed.std())

    @property
    def standardised(self) -> Array:
        """Transformed output with mean 0 and standard deviation 1, (n,)."""
        standardised: Array = (self.transformed - self.mean) / self.spread
        return standardised

    def restore(self, standardised: Array) -> Array:
        """Values in the unit of the output from values on the scale of `standardised`, of any shape."""
        return self._inverse(self.mean + self.spread * standardised)

    def transformed_of(self, values: Array) -> Array:
        """Transform values of the output."""
        return np.log(values) if self.transform == "log" else values

    def _inverse(self, values: Array) -> Array:
        return np.exp(values) if self.transform == "log" else values

    def under(self, transform: Transform, realisations: Integers | None = None) -> "TrainingSet":
        """Return the same samples with another transformation, and the effects of the realisations that they share.

        An InputError where the output has no logarithm.
        """
        if transform not in TRANSFORMS:
            raise InputError(f"unknown transformation {transform!r}, allowed: {', '.join(TRANSFORMS)}")
        if transform == "log" and not (self.y > 0.0).all():
            row = int(np.flatnonzero(self.y <= 0.0)[0])
            raise InputError(f"y[{row}] = {self.y[row]:g} has no logarithm, allowed: above 0, or transform='none'")
        found = replace(self, transform=transform, effects=None)
        if realisations is None or len(np.unique(realisations)) < 2:
            return found
        return replace(found, effects=RealisationEffects.fit(found.unit, found.transformed, realisations))

    def without_effects(self, values: Array, realisations: Integers | None) -> Array:
        """Take the effects of realisations (m,), as these samples show them, off other outputs (m,)."""
        if self.effects is None or realisations is None:
            return values
        return self._inverse(self.transformed_of(values) - self.effects.on(realisations))

    def subset(self, rows: Integers) -> "TrainingSet":
        """Keep the samples of the given rows; they may be fewer than `MINIMUM_SAMPLES`."""
        _refuse_constant(self.y[rows])
        part = replace(self, X=self.X[rows], y=self.y[rows])
        if self.effects is None:
            return part
        return replace(part, effects=self.effects.subset(rows, part.unit, self.transformed_of(part.y)))


def to_unit(X: Array, bounds: Array) -> Array:
    """Scale points (n, d) from the bounds (d, 2) to the unit cube."""
    scaled: Array = (X - bounds[:, 0]) / (bounds[:, 1] - bounds[:, 0])
    return scaled


def checked_bounds(bounds: ArrayLike) -> Array:
    """Bounds as an array (d, 2), or an InputError that says what is wrong."""
    checked = np.asarray(bounds, dtype=float)
    if checked.ndim != 2 or checked.shape[1] != 2 or not len(checked):
        raise InputError(f"bounds of shape {checked.shape}, allowed: (d, 2)")
    wrong = np.flatnonzero(~(np.isfinite(checked).all(axis=1) & (checked[:, 0] < checked[:, 1])))
    if wrong.size:
        k = int(wrong[0])
        raise InputError(f"bounds of input {k}: {checked[k].tolist()}, allowed: lower below upper, both finite")
    return checked


def checked_points(X: ArrayLike, bounds: Array) -> Array:
    """Points as an array (n, d) inside the bounds, or an InputError that names the first offender."""
    points = np.asarray(X, dtype=float)
    if points.ndim != 2 or points.shape[1] != len(bounds):
        raise InputError(f"X of shape {points.shape}, allowed: (n, {len(bounds)}), as many columns as bounds")
    if not np.isfinite(points).all():
        row, column = np.argwhere(~np.isfinite(points))[0]
        raise InputError(f"X[{row}, {column}] is {points[row, column]}, allowed: finite numbers")
    slack = OUTSIDE_TOLERANCE * (bounds[:, 1] - bounds[:, 0])
    outside = (points < bounds[:, 0] - slack) | (points > bounds[:, 1] + slack)
    if outside.any():  # asked first: the search takes a hundred times as long
        row, column = np.argwhere(outside)[0]
        lower, upper = bounds[column]
        raise InputError(f"X[{row}, {column}] = {points[row, column]:g}, allowed: {lower:g} to {upper:g}, its bounds")
    return points


def checked_samples(
    X: ArrayLike, y: ArrayLike, bounds: ArrayLike, realisations: ArrayLike | None = None
) -> TrainingSet:
    """Check a training set.

    Parameters
    ----------
    X : array_like, shape (n, d)
    y : array_like, shape (n,)
    bounds : array_like, shape (d, 2)
    realisations : array_like of int, shape (n,), optional
        Under which realisation of the loads each sample was simulated, numbered from 0.

    Raises
    ------
    InputError
        Wrong shapes, values that are not finite, points outside the bounds, fewer than `MINIMUM_SAMPLES` points, an
        output that does not vary, or one point with two different values under one realisation.
    """
    box = checked_bounds(bounds)
    points = checked_points(X, box)
    values = np.asarray(y, dtype=float)
    if values.shape != (len(points),):
        raise InputError(f"y of shape {values.shape}, allowed: ({len(points)},), as many as rows of X")
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values))[0])
        raise InputError(f"y[{row}] is {values[row]}, allowed: finite numbers")
    if len(points) < MINIMUM_SAMPLES:
        raise InputError(f"{len(points)} samples for a surrogate, allowed: at least {MINIMUM_SAMPLES}")
    _refuse_constant(values)
    labels = (
        np.zeros(len(points), dtype=np.int64) if realisations is None else _checked_labels(realisations, len(points))
    )
    _refuse_contradictions(np.column_stack([points, labels]), values)
    return TrainingSet(points, values, box)


def _checked_labels(realisations: ArrayLike, count: int) -> Integers:
    """Return the realisations as an array, or an InputError that says what is wrong."""
    labels = np.asarray(realisations)
    if labels.shape != (count,) or labels.dtype.kind not in "iu" or labels.min() < 0:
        raise InputError(f"realisations of shape {labels.shape}, allowed: {count} whole numbers from 0, one a row of X")
    return labels.astype(np.int64)


def _refuse_constant(values: Array) -> None:
    """Raise if an output does not vary."""
    if np.ptp(values) <= CONSTANT_TOLERANCE * np.abs(values).max():
        raise InputError(f"the output is constant ({values[0]:g}), allowed: one with a variance to explain")


def _refuse_contradictions(points: Array, values: Array) -> None:
    """Raise if one point has two different values: no function of the inputs passes through both."""
    _, group = np.unique(points, axis=0, return_inverse=True)
    order = np.argsort(group.ravel(), kind="stable")
    same = np.diff(group.ravel()[order]) == 0
    clash = np.flatnonzero(same & (np.diff(values[order]) != 0))
    if clash.size:
        first, second = sorted(int(row) for row in order[clash[0] : clash[0] + 2])
        raise InputError(f"rows {first} and {second} of X are the same point, y differs; allowed: one value a point")
