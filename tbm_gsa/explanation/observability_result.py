"""What `machine observe` prints."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from tbm_gsa.reading import MachineFile, Maybe, Name, Part, TextLine
from tbm_msgs_py.base.fields import Vector3


class Smallest(Part):
    """Smallest relative changes that are found; NaN where the range of the value ends before.

    Attributes
    ----------
    decrease : float
        0.1 if a fall by 10 % is found.
    increase : float
    """

    decrease: Maybe
    increase: Maybe

    @property
    def found(self) -> bool:
        """Whether any change can be found."""
        return not (math.isnan(self.decrease) and math.isnan(self.increase))

    def ways(self) -> tuple[str, str]:
        """Fall and rise for a table; a dash beyond the range."""
        fall, rise = ("–" if math.isnan(way) else f"{way:.1%}" for way in (self.decrease, self.increase))
        return fall, rise


class ObservedInput(Smallest):
    """An input of the machine.

    Attributes
    ----------
    name, unit : str
    value : float
        Of the machine.
    hidden_by_loads : float
        Share of the information on it that is lost because the level of the loads is not known.
    """

    name: TextLine
    unit: TextLine
    value: float
    hidden_by_loads: Maybe

    def lost_to_loads(self) -> str:
        """Share for a table."""
        return "–" if math.isnan(self.hidden_by_loads) else f"{self.hidden_by_loads:.0%}"


class ObservedLoad(Smallest):
    """A factor of the loads, and its value in the machine file."""

    value: float


class Observable(Part):
    """The smallest changes that a recording could show.

    Attributes
    ----------
    false_rate, probability : float
        Share of recordings of an unchanged machine in which any input is accused, and with which a change is found.
    inputs, loads : dict
        By code, and by group.
    """

    false_rate: float
    probability: float
    inputs: dict[Name, ObservedInput]
    loads: dict[Name, ObservedLoad]


class SimilarPair(Part):
    """Two inputs that do nearly the same.

    Attributes
    ----------
    inputs : tuple of str
    correlation : float
        Cosine between what they do to the statistics, the loads free.
    times : float
        How many times the smallest change that is found one must be so that it is told from the other; NaN: never.
    """

    inputs: tuple[Name, Name]
    correlation: Annotated[float, Field(ge=-1.0 - 1e-9, le=1.0 + 1e-9)]
    times: Maybe


class SensorSpot(Part):
    """A sensor: on a rigid arm from the node of a test point (m), fixed or turning with the head."""

    point: Name
    node: int
    offset: Vector3
    frame: Literal["fixed", "rotating"]

    @property
    def name(self) -> str:
        """Test point, and the arm where there is one."""
        arm = ", ".join(f"{value:g}" for value in self.offset)
        return f"{self.point} at ({arm})" if any(self.offset) else self.point


class SensorGain(SensorSpot):
    """What a sensor more would add.

    Attributes
    ----------
    bits : float
        Information on all inputs together.
    inputs, loads : tuple of str
        That can be found then, and could not before.
    smaller : dict of str to float
        By what factor the smallest change becomes smaller, of inputs that can be found before.
    """

    bits: float
    inputs: tuple[Name, ...]
    loads: tuple[Name, ...]
    smaller: dict[Name, float]


class Observability(Observable):
    """What sensors can see in a recording of a length.

    Attributes
    ----------
    duration : float
        s.
    noise_density : float
        m/s²/√Hz.
    model_error : float
    statistics, unused : tuple of str
        Band powers that say something, and that do not, for the noise or a stronger band rules there.
    pairs : tuple of SimilarPair
    candidates : tuple of SensorGain
        The most helpful first.
    """

    machine: Name
    machine_file: MachineFile
    duration: float
    noise_density: float
    model_error: float
    sensors: tuple[SensorSpot, ...]
    statistics: tuple[Name, ...]
    unused: tuple[Name, ...]
    pairs: tuple[SimilarPair, ...]
    candidates: tuple[SensorGain, ...]
    versions: dict[Name, TextLine]
