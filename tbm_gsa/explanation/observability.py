"""What the sensors on a machine can see at all: which inputs and loads, how large a change must be, what would help.

The statistics are the logarithms of band powers, as the explanation of a recording uses them. Their slopes over the
logarithm of an input are taken from the machine a step less and more; those over the loads' factors are
known. Chance is that of a recording of a given length with a given noise of the sensors. The rest is linear (see
`detection`): a change beyond a factor of two is an extrapolation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, count
from typing import Final

import numpy as np

from tbm_dynamics import Machine
from tbm_dynamics.loads.description import LoadFactors
from tbm_dynamics.machine.sensor_place import SensorPlace
from tbm_gsa.explanation.band_reading import BandReading, Sensor
from tbm_gsa.explanation.load_posterior import MODEL_ERROR, BandObservation, load_posterior
from tbm_gsa.explanation.load_scatter import load_scatter
from tbm_gsa.explanation.load_transfer import MachineMotion, load_transfer, machine_motion
from tbm_gsa.explanation.observability_result import (
    Observability,
    SensorGain,
    SensorSpot,
    SimilarPair,
)
from tbm_gsa.explanation.ranges import explaining_inputs, loads_prior
from tbm_gsa.explanation.visibility import FALSE_RATE, PROBABILITY, Visibility, step_ends
from tbm_gsa.provenance import machine_sha256, package_versions
from tbm_gsa.reading import MachineFile
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_gsa.signals.conditioning import Frame
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.fields import Vector3

SEGMENT_S: Final = BandReading.segment_s
SIMILAR: Final = 0.9
"""Correlation from which on two inputs are named as a pair."""

RunMachines = Callable[[Callable[[Machine], Array], Iterable[Machine]], Iterable[Array]]
"""`map`, or that of a pool of processes."""


@dataclass(frozen=True)
class SensorChoice:
    """A sensor: its test point, its offset from the node (m, by default the machine's), whether it turns."""

    point: str
    offset: Vector3 | None = None
    frame: Frame = "fixed"


@dataclass(frozen=True)
class ObservationSettings:
    """How the sensors are used.

    Attributes
    ----------
    duration_s : float
        Of a recording.
    noise_density : float
        Of every sensor, one-sided, m/s²/√Hz.
    model_error : float
        Standard deviation of a band power's logarithm that the model is wrong by in any case.
    false_rate : float
        Share of recordings of an unchanged machine in which any input is accused.
    probability : float
        With which a change is to be found.
    """

    duration_s: float = 60.0
    noise_density: float = 100e-6 * 9.80665
    model_error: float = MODEL_ERROR
    false_rate: float = FALSE_RATE
    probability: float = PROBABILITY


def observability(
    machine: Machine,
    sensors: Sequence[SensorChoice],
    candidates: Sequence[SensorChoice] = (),
    settings: ObservationSettings | None = None,
    run: RunMachines = map,
) -> Observability:
    """Find what sensors on a machine at its operating point can see.

    Parameters
    ----------
    machine : Machine
    sensors : sequence of SensorChoice
    candidates : sequence of SensorChoice, optional
        Places of one sensor more; where there is one already is left out.
    settings : ObservationSettings, optional
    run : callable, optional
        Maps a function over machines: two for each input, about 0.3 s each.

    Raises
    ------
    InputError
        No sensor, one twice, a test point that the machine does not have, a recording that is too short, sensors whose
        noise covers everything, loads without fluctuation.
    """
    chosen = settings or ObservationSettings()
    _check(chosen)
    if not machine.driven_loads.bands:
        raise InputError(
            f"loads of {machine.name}: nothing fluctuates at its operating point, allowed: regions or lines"
        )
    spots = _spots(machine, sensors, candidates)
    equipped, reading = _equipped(machine, [spot for _, spot in spots.values()], list(spots))
    seen = _Observation.of(machine, equipped, reading, chosen, run)
    own = [name for name, (given, _) in spots.items() if given]
    before = seen.view(own)
    gains = [seen.gain(before, seen.view([*own, name]), spot) for name, (given, spot) in spots.items() if not given]
    return Observability(
        machine=machine.name,
        machine_file=MachineFile(origin=machine.origin, sha256=machine_sha256(machine)),
        duration=chosen.duration_s,
        noise_density=chosen.noise_density,
        model_error=chosen.model_error,
        false_rate=chosen.false_rate,
        probability=chosen.probability,
        sensors=tuple(spots[name][1] for name in own),
        statistics=tuple(before.names),
        unused=tuple(before.unused),
        inputs=before.visible.inputs(),
        loads=before.visible.loads(),
        pairs=tuple(seen.pairs(before)),
        candidates=tuple(sorted(gains, key=lambda one: -one.bits)),
        versions=package_versions(),
    )


def _check(settings: ObservationSettings) -> None:
    if not SEGMENT_S <= settings.duration_s < math.inf:
        raise InputError(f"recording of {settings.duration_s:g} s, allowed: at least a segment of {SEGMENT_S:g} s")
    if not 0.0 <= settings.noise_density < math.inf:
        raise InputError(f"noise density {settings.noise_density:g} m/s²/√Hz, allowed: 0 or more")
    if not 0.0 < settings.model_error < math.inf:
        raise InputError(f"model error {settings.model_error:g}, allowed: a positive number")


def _spots(
    machine: Machine, sensors: Sequence[SensorChoice], candidates: Sequence[SensorChoice]
) -> dict[str, tuple[bool, SensorSpot]]:
    """Places by a name of their own, and whether a sensor is there already: a second one of a point is POINT_2."""
    if not sensors:
        raise InputError("no sensor, allowed: at least one test point")
    known = machine.description.sensor_places
    found: dict[str, tuple[bool, SensorSpot]] = {}
    for given, choices in ((True, sensors), (False, candidates)):
        for choice in choices:
            if choice.point not in known:
                raise InputError(f"test point {choice.point!r}: machine {machine.name} has {', '.join(known)}")
            place = known[choice.point].at(choice.offset)
            spot = SensorSpot(point=choice.point, node=place.node, offset=place.offset, frame=choice.frame)
            if spot not in [one for _, one in found.values()]:
                found[_free_name(choice.point, found)] = given, spot
            elif given:
                raise InputError(f"sensor {spot.name}: given twice, allowed: each place once")
    return found


def _free_name(point: str, taken: Container[str]) -> str:
    names = (point if number == 1 else f"{point}_{number}" for number in count(1))
    return next(name for name in names if name not in taken)


def _equipped(machine: Machine, spots: Sequence[SensorSpot], names: Sequence[str]) -> tuple[Machine, BandReading]:
    """Machine whose test points are the places, and a reading of all of them."""
    places = {
        name: SensorPlace(node=spot.node, offset=spot.offset).shortest for name, spot in zip(names, spots, strict=True)
    }
    equipped = Machine(machine.base.model_copy(update={"test_points": places}), machine.inputs, machine.origin)
    sensors = {name: Sensor(spot.frame) for name, spot in zip(names, spots, strict=True)}
    return equipped, BandReading(sensors, machine.driven_loads.bands)


def _powers(reading: BandReading, factors: Array, machine: Machine) -> Array:
    """Band powers of a machine, (k,), without noise."""
    return load_transfer(machine, reading).predict(factors)


@dataclass(frozen=True, eq=False)
class _View:
    """What a set of sensors says, and which of its statistics do."""

    names: list[str]
    unused: list[str]
    visible: Visibility


@dataclass(frozen=True, eq=False)
class _Observation:
    """A machine with sensors everywhere that is looked at; k statistics, n inputs.

    Attributes
    ----------
    motion : MachineMotion
    prior : LoadFactors
    inputs : InputSet
    powers : ndarray, shape (2, n, k)
        With each input a step less and a step more.
    steps : ndarray, shape (n,)
        Logarithms of the value more over the value less.
    settings : ObservationSettings
    """

    motion: MachineMotion
    prior: LoadFactors
    inputs: InputSet
    powers: Array
    steps: Array
    settings: ObservationSettings

    @classmethod
    def of(
        cls, machine: Machine, equipped: Machine, reading: BandReading, settings: ObservationSettings, run: RunMachines
    ) -> _Observation:
        """Compute the machine with every input less and more."""
        prior = loads_prior(machine)
        inputs = explaining_inputs(machine)
        ends = np.array([step_ends(item) for item in inputs.inputs]).T
        machines = (
            equipped.with_inputs(**{code: float(value)})
            for values in ends
            for code, value in zip(inputs.codes, values, strict=True)
        )
        found = np.array(list(run(partial(_powers, reading, prior.values), machines)))
        motion = machine_motion(equipped, reading)
        return cls(
            motion,
            prior,
            inputs,
            found.reshape(2, len(inputs), -1),
            np.asarray(np.diff(np.log(ends), axis=0)[0]),
            settings,
        )

    def view(self, names: Sequence[str]) -> _View:
        """Return what some of the sensors say."""
        motion, places = _of_sensors(self.motion, names)
        scatter, chosen, prior = load_scatter(motion), self.settings, self.prior
        noise = np.full(len(places), chosen.noise_density**2)
        expected = scatter.expected(prior.values, noise)
        observed = BandObservation(expected, noise, chosen.duration_s)
        found = load_posterior(observed, scatter, prior, chosen.model_error)
        used = found.used
        less, more = np.log(self.powers[:, :, places[used]] + (scatter.width * noise)[used])
        slopes = (more - less) / self.steps[:, None]
        loads = 2.0 * np.square(prior.values)[:, None] * scatter.transfer.gain[:, used] / expected[used]
        statistics = [statistic.name for statistic in motion.reading.statistics]
        return _View(
            names=[statistics[place] for place in used],
            unused=[name for place, name in enumerate(statistics) if place not in set(used.tolist())],
            visible=Visibility.of(
                self.inputs, prior, slopes, found.scatter, loads, chosen.false_rate, chosen.probability
            ),
        )

    def pairs(self, view: _View) -> list[SimilarPair]:
        """Pair inputs that do nearly the same, the most similar first."""
        correlation, codes = view.visible.changes.correlation, self.inputs.codes
        found = [code for code, one in view.visible.inputs().items() if one.found]
        pairs = [
            SimilarPair(inputs=(codes[i], codes[j]), correlation=value, times=_times(value))
            for i, j in combinations(range(len(codes)), 2)
            if abs(value := float(correlation[i, j])) >= SIMILAR and codes[i] in found and codes[j] in found
        ]
        return sorted(pairs, key=lambda pair: -abs(pair.correlation))

    def gain(self, before: _View, after: _View, spot: SensorSpot) -> SensorGain:
        """Return what one sensor more would add."""
        widths = [math.log(item.upper / item.lower) for item in self.inputs.inputs]
        prior = np.array(widths) / math.sqrt(12.0)  # of a uniform law
        first, then = before.visible, after.visible
        inputs, loads = first.inputs(), first.loads()
        seen_after = [code for code, one in then.inputs().items() if one.found]
        return SensorGain(
            **dict(spot),
            bits=then.changes.bits(prior) - first.changes.bits(prior),
            inputs=tuple(code for code in seen_after if not inputs[code].found),
            loads=tuple(group for group, one in then.loads().items() if one.found and not loads[group].found),
            smaller={
                code: float(first.smallest[place] / then.smallest[place])
                for place, code in enumerate(self.inputs.codes)
                if code in seen_after and inputs[code].found
            },
        )


def _of_sensors(motion: MachineMotion, names: Sequence[str]) -> tuple[MachineMotion, Integers]:
    """Motion of some of the sensors, and where their statistics are among all."""
    every = list(motion.reading.sensors)
    columns = np.concatenate([3 * every.index(name) + np.arange(3) for name in names])
    points = np.array([statistic.point for statistic in motion.reading.statistics])
    part = replace(
        motion,
        reading=replace(motion.reading, sensors={name: motion.reading.sensors[name] for name in names}),
        noise=motion.noise[:, columns],
        lines=motion.lines[:, columns],
        mesh=motion.mesh[:, columns],
        modulated=motion.modulated[:, :, columns],
    )
    return part, np.concatenate([np.flatnonzero(points == name) for name in names])


def _times(correlation: float) -> float:
    left = 1.0 - correlation**2
    return 1.0 / math.sqrt(left) if left > 0.0 else math.nan
