"""The ``loads:`` section of a machine file: means, frequency regions and lines of the cutterhead loads."""

from itertools import pairwise
from typing import Literal, Self

import numpy as np
from pydantic import Field, FiniteFloat, model_validator

from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.fields import FrozenModel
from tbm_msgs_py.base.texts import Source

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
LOWEST_HZ = 0.5  # nothing fluctuates below it, so that a mean over a run is the mean
HIGHEST_HZ = 240.0  # what the grid of the spectral model carries
NARROWEST_HZ = 2.0  # what its filters can cut out cleanly


class LoadRegion(FrozenModel):
    """A band of the spectrum filled with Gaussian noise.

    Attributes
    ----------
    band : tuple of float
        Lower and upper limit, Hz. A band that starts below 0.5 Hz is filled from 0.5 Hz on.
    rms : float
        Root mean square of the band, N (forces) or N·m (moments).
    source : Source
        Where the amplitude comes from.
    """

    band: tuple[FiniteFloat, FiniteFloat]
    rms: FiniteFloat = Field(ge=0.0)
    source: Source

    @property
    def filled(self) -> tuple[float, float]:
        """The limits that are really filled, Hz."""
        return max(self.band[0], LOWEST_HZ), self.band[1]

    @model_validator(mode="after")
    def _check_band(self) -> Self:
        low, high = self.filled
        if self.band[0] < 0.0 or high - low < NARROWEST_HZ or high > HIGHEST_HZ:
            limits = f"0 to {HIGHEST_HZ:g} Hz, at least {NARROWEST_HZ:g} Hz wide above {LOWEST_HZ:g} Hz"
            raise ValueError(f"band {list(self.band)} is outside what is allowed: {limits}")
        return self


class LoadLine(FrozenModel):
    """A single frequency of constant amplitude.

    Attributes
    ----------
    frequency : float
        Hz, above 0.5 and up to 240.
    amplitude : float
        Of the cosine, N or N·m.
    source : Source
        Where the amplitude comes from.
    """

    frequency: FiniteFloat = Field(gt=LOWEST_HZ, le=HIGHEST_HZ)
    amplitude: FiniteFloat = Field(ge=0.0)
    source: Source


class LoadComponent(FrozenModel):
    """One of the six load components.

    Attributes
    ----------
    mean : float
        Signed, N or N·m, at the reference operating point.
    scales_with : {"thrust", "torque"}
        Quantity of the operating point that scales mean and fluctuation alike.
    regions, lines
        The fluctuation.
    source : Source
        Where the mean and the frequencies come from.
    """

    mean: FiniteFloat
    scales_with: Literal["thrust", "torque"]
    regions: tuple[LoadRegion, ...] = ()
    lines: tuple[LoadLine, ...] = ()
    source: Source

    @property
    def fluctuation_rms(self) -> float:
        """Root mean square of regions and lines together, N or N·m."""
        power = sum(r.rms**2 for r in self.regions) + sum(line.amplitude**2 / 2.0 for line in self.lines)
        return float(np.sqrt(power))

    @model_validator(mode="after")
    def _check_overlap(self) -> Self:
        bands = sorted(region.band for region in self.regions)
        for lower, upper in pairwise(bands):
            if upper[0] < lower[1]:
                raise ValueError(f"regions {list(lower)} and {list(upper)} overlap; allowed: disjoint bands")
        return self


class LoadDescription(FrozenModel):
    """The six components of the wrench that the rock exerts on node 1."""

    fx: LoadComponent
    fy: LoadComponent
    fz: LoadComponent
    mx: LoadComponent
    my: LoadComponent
    mz: LoadComponent

    @property
    def components(self) -> tuple[LoadComponent, ...]:
        """The six components in the order fx, fy, fz, mx, my, mz."""
        return self.fx, self.fy, self.fz, self.mx, self.my, self.mz

    @property
    def mean(self) -> Array:
        """Means at the reference operating point, (6,), N and N·m."""
        return np.array([component.mean for component in self.components])

    def scale(self, thrust_ratio: float, torque_ratio: float) -> Array:
        """Factors of the components at another operating point.

        Parameters
        ----------
        thrust_ratio, torque_ratio : float
            Thrust and cutterhead torque over those of the machine file.

        Returns
        -------
        ndarray, shape (6,)
        """
        ratios = {"thrust": thrust_ratio, "torque": torque_ratio}
        return np.array([ratios[component.scales_with] for component in self.components], dtype=float)
