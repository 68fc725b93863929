"""Distributions of an input, all bounded: monotone maps between its values and the unit interval.

Surrogates and indices work on the unit cube; there every input is uniform, whatever its distribution.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from typing import ClassVar, Final, Protocol

import numpy as np
import scipy  # its parts load on first use
from numpy.typing import ArrayLike

from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.texts import quoted


class _ScipyLaw(Protocol):
    """Frozen distribution of scipy."""

    def cdf(self, values: ArrayLike, /) -> Array: ...
    def ppf(self, probabilities: ArrayLike, /) -> Array: ...


@dataclass(frozen=True)
class Distribution(ABC):
    """Law of one input.

    Parameters
    ----------
    lower, upper : float
        No value lies outside.
    """

    lower: float
    upper: float
    name: ClassVar[str]
    family: ClassVar[str]

    def __post_init__(self) -> None:
        for key, value in asdict(self).items():
            if not np.isfinite(value):
                raise StudyError(f"{key} {value}, allowed: a finite number")
        if self.lower >= self.upper:
            raise StudyError(f"lower {self.lower:g}, allowed: below upper, {self.upper:g}")
        self._check()

    def to_unit(self, values: ArrayLike) -> Array:
        """Cumulative probability of values, 0 at and below the lower bound, 1 at and above the upper; any shape."""
        return np.asarray(self._law.cdf(values), dtype=np.float64)

    def from_unit(self, unit: ArrayLike) -> Array:
        """Quantiles of probabilities from 0 to 1, any shape; inverse of `to_unit`."""
        return np.asarray(np.clip(self._law.ppf(unit), self.lower, self.upper), dtype=np.float64)

    def to_dict(self) -> dict[str, str | float]:
        """Plain data, as in a file."""
        return {"distribution": self.name, **asdict(self)}

    def _check(self) -> None:  # noqa: B027 - the bounds are all that a uniform distribution has
        """Raise a StudyError for parameters that are not allowed."""

    def _check_inside(self, key: str, value: float) -> None:
        if not self.lower <= value <= self.upper:
            raise StudyError(f"{key} {value:g}, allowed: {self.lower:g} to {self.upper:g}")

    @cached_property
    def _law(self) -> _ScipyLaw:
        """The distribution in scipy, with its parameters."""
        law: _ScipyLaw = getattr(scipy.stats, self.family)(*self._parameters())
        return law

    @abstractmethod
    def _parameters(self) -> tuple[float, ...]:
        """Parameters of the family: of its shape, location, scale."""


@dataclass(frozen=True)
class Uniform(Distribution):
    """Every value between the bounds is equally likely."""

    name, family = "uniform", "uniform"

    def _parameters(self) -> tuple[float, ...]:
        return self.lower, self.upper - self.lower


@dataclass(frozen=True)
class LogUniform(Distribution):
    """The logarithm is uniform: every decade between the bounds is equally likely."""

    name, family = "log-uniform", "loguniform"

    def _check(self) -> None:
        if self.lower <= 0.0:
            raise StudyError(f"lower {self.lower:g} of a log-uniform distribution, allowed: above 0")

    def _parameters(self) -> tuple[float, ...]:
        return self.lower, self.upper


@dataclass(frozen=True)
class Normal(Distribution):
    """Normal, cut off at the bounds and renormalised: mean and standard deviation are those before the cut."""

    mean: float
    std: float
    name, family = "normal", "truncnorm"

    def _check(self) -> None:
        if self.std <= 0.0:
            raise StudyError(f"std {self.std:g}, allowed: above 0")
        self._check_inside("mean", self.mean)
        with np.errstate(all="ignore"):
            quartiles = self.from_unit([0.25, 0.5, 0.75])
        if not (np.diff(quartiles) > 0.0).all():  # also where they are no numbers
            width = self.upper - self.lower
            raise StudyError(f"std {self.std:g}, allowed: a size that tells values {width:g} apart from each other")

    def _parameters(self) -> tuple[float, ...]:
        return (self.lower - self.mean) / self.std, (self.upper - self.mean) / self.std, self.mean, self.std


@dataclass(frozen=True)
class LogNormal(Distribution):
    """The logarithm is normal, cut off at the bounds and renormalised; log_sigma is its deviation before the cut."""

    median: float
    log_sigma: float
    name, family = "log-normal", "truncnorm"

    def to_unit(self, values: ArrayLike) -> Array:
        """See `Distribution.to_unit`."""
        return super().to_unit(np.log(np.clip(values, self.lower, self.upper)))

    def from_unit(self, unit: ArrayLike) -> Array:
        """See `Distribution.from_unit`."""
        return np.asarray(np.clip(np.exp(self._law.ppf(unit)), self.lower, self.upper), dtype=np.float64)

    def _check(self) -> None:
        if self.lower <= 0.0:
            raise StudyError(f"lower {self.lower:g} of a log-normal distribution, allowed: above 0")
        if self.log_sigma <= 0.0:
            raise StudyError(f"log_sigma {self.log_sigma:g}, allowed: above 0")
        self._check_inside("median", self.median)

    def _parameters(self) -> tuple[float, ...]:
        middle, size = np.log(self.median), self.log_sigma
        return (np.log(self.lower) - middle) / size, (np.log(self.upper) - middle) / size, middle, size


@dataclass(frozen=True)
class Triangular(Distribution):
    """Density that rises linearly from the lower bound to the mode and falls to the upper bound."""

    mode: float
    name, family = "triangular", "triang"

    def _check(self) -> None:
        self._check_inside("mode", self.mode)

    def _parameters(self) -> tuple[float, ...]:
        width = self.upper - self.lower
        return (self.mode - self.lower) / width, self.lower, width


DISTRIBUTIONS: Final[Mapping[str, type[Distribution]]] = {
    kind.name: kind for kind in (Uniform, Normal, Triangular, LogUniform, LogNormal)
}


def distribution_from(given: Mapping[str, object]) -> Distribution:
    """Build a distribution from plain data; inverse of `Distribution.to_dict`.

    Parameters
    ----------
    given : mapping
        ``distribution``, uniform if left out, and the parameters of that one.

    Raises
    ------
    StudyError
        An unknown distribution; a parameter that is missing, unknown, no number or not allowed.
    """
    name = given.get("distribution", Uniform.name)
    if not isinstance(name, str) or name not in DISTRIBUTIONS:
        raise StudyError(f"unknown distribution {quoted(name)}, allowed: {', '.join(DISTRIBUTIONS)}")
    kind = DISTRIBUTIONS[name]
    allowed = [field.name for field in fields(kind)]
    for key in given:
        if key not in {*allowed, "distribution"}:
            raise StudyError(f"unknown key {quoted(key)} of a {name} distribution, allowed: {', '.join(allowed)}")
    missing = [key for key in allowed if key not in given]
    if missing:
        raise StudyError(f"{', '.join(missing)}: missing, allowed: a {name} distribution with {', '.join(allowed)}")
    return kind(**{key: number(key, given[key]) for key in allowed})


def number(key: str, value: object) -> float:
    """Return a number from plain data; raise a StudyError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise StudyError(f"{key} {quoted(value)}, allowed: a number")
    try:
        return float(value)
    except OverflowError:  # a whole number of hundreds of digits
        raise StudyError(f"{key} {quoted(value)}, allowed: a number that a computer holds") from None
