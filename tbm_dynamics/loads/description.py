"""The ``loads:`` section of a machine file: means, frequency regions, lines and factors of the cutterhead loads."""

import math
from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Final, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, FiniteFloat, model_validator

from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.fields import FrozenModel, NonNegative, Positive, Source

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
LOWEST_HZ = 0.5  # nothing fluctuates below it, so that a mean over a run is the mean
HIGHEST_HZ = 240.0  # what the grid of the spectral model carries
NARROWEST_HZ = 2.0  # what its filters can cut out cleanly
BESIDE_HZ = 2.0  # of a line, that its band holds


LoadGroup = Literal["axial_low", "axial_high", "torsion_low", "torsion_high", "lateral", "moments"]
LOAD_GROUPS: Final[tuple[LoadGroup, ...]] = get_args(LoadGroup)
_GROUPS: Final[Mapping[str, tuple[LoadGroup, LoadGroup]]] = {
    "fx": ("axial_low", "axial_high"),
    "fy": ("lateral", "lateral"),
    "fz": ("lateral", "lateral"),
    "mx": ("torsion_low", "torsion_high"),
    "my": ("moments", "moments"),
    "mz": ("moments", "moments"),
}
"""Groups of each component: of its lowest region and the lines up to its end, and of all that is above."""


class LoadFactors(FrozenModel):
    """Factors on the amplitude of the fluctuation, which the rock changes by the hour; means are left as they are.

    Attributes
    ----------
    axial_low, axial_high : float
        F_x up to the end of its lowest region, and above.
    torsion_low, torsion_high : float
        M_x likewise.
    lateral, moments : float
        F_y and F_z; M_y and M_z.
    log_sigma : float
        Standard deviation of their logarithms where they are not known; the median is the factor.
    source : Source
        Where they come from.
    """

    axial_low: NonNegative = 1.0
    axial_high: NonNegative = 1.0
    torsion_low: NonNegative = 1.0
    torsion_high: NonNegative = 1.0
    lateral: NonNegative = 1.0
    moments: NonNegative = 1.0
    log_sigma: Positive = math.log(2.0)
    source: Source = "assumed"

    @property
    def values(self) -> Array:
        """The six factors in the order of `LOAD_GROUPS`, (6,)."""
        return np.array([getattr(self, group) for group in LOAD_GROUPS])


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

    def scaled(self, low: float, high: float) -> Self:
        """Component with the amplitudes of its lowest region, and lines up to its end, times `low`, others `high`."""
        end = min((region.band[1] for region in self.regions), default=math.inf)
        regions = (r.model_copy(update={"rms": r.rms * (low if r.band[1] <= end else high)}) for r in self.regions)
        lines = (
            line.model_copy(update={"amplitude": line.amplitude * (low if line.frequency <= end else high)})
            for line in self.lines
        )
        return self.model_copy(update={"regions": tuple(regions), "lines": tuple(lines)})

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
    factors: LoadFactors = LoadFactors()

    @property
    def components(self) -> tuple[LoadComponent, ...]:
        """The six components in the order fx, fy, fz, mx, my, mz, their fluctuation with the factors on it."""
        found = []
        for name, groups in _GROUPS.items():
            low, high = (getattr(self.factors, group) for group in groups)
            found.append(getattr(self, name).scaled(low, high))
        return tuple(found)

    @property
    def bands(self) -> tuple[tuple[float, float], ...]:
        """Bands in which the loads fluctuate, Hz: regions, of which overlapping ones are one, and lines beside them."""
        parts = [getattr(self, name) for name in COMPONENTS]
        bands = _merged(region.filled for part in parts for region in part.regions)
        lines = {line.frequency for part in parts for line in part.lines}
        alone = [line for line in lines if not any(low <= line <= high for low, high in bands)]
        return _merged((*bands, *((max(line - BESIDE_HZ, LOWEST_HZ), line + BESIDE_HZ) for line in alone)))

    @property
    def at_rest(self) -> Self:
        """Return the loads on a head that does not turn: their means."""
        still = {name: getattr(self, name).model_copy(update={"regions": (), "lines": ()}) for name in COMPONENTS}
        return self.model_copy(update=still)

    def with_factors(self, factors: ArrayLike) -> Self:
        """Return the same loads with other factors (6,), in the order of `LOAD_GROUPS`."""
        values = np.asarray(factors, dtype=float).tolist()
        changed = dict(zip(LOAD_GROUPS, values, strict=True))
        return self.model_copy(update={"factors": self.factors.model_copy(update=changed)})

    @property
    def mean(self) -> Array:
        """Means at the reference operating point, (6,), N and N·m."""
        return np.array([getattr(self, name).mean for name in COMPONENTS])

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


def _merged(bands: Iterable[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    found: list[tuple[float, float]] = []
    for low, high in sorted(bands):
        if found and low < found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], high)
        else:
            found.append((low, high))
    return tuple(found)
