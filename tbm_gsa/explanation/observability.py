"""What the sensors on a machine can see at all: which inputs and loads, how large a change must be, what would help.

The statistics are the logarithms of band powers, as the explanation of a recording uses them. Their slopes over the
logarithm of an input are taken from the machine with the input `STEP` less and more; those over the loads' factors are
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
from tbm_dynamics.loads.description import LOAD_GROUPS, LoadFactors
from tbm_dynamics.machine.sensor_place import SensorPlace
from tbm_gsa.explanation.band_reading import BandReading, Sensor
from tbm_gsa.explanation.detection import Detection
from tbm_gsa.explanation.load_posterior import MODEL_ERROR, BandObservation, load_posterior
from tbm_gsa.explanation.load_scatter import load_scatter
from tbm_gsa.explanation.load_transfer import MachineMotion, load_transfer, machine_motion
from tbm_gsa.explanation.observability_result import (
    Observability,
    ObservedInput,
    ObservedLoad,
    SensorGain,
    SensorSpot,
    SimilarPair,
)
from tbm_gsa.explanation.ranges import explaining_inputs, loads_prior
from tbm_gsa.provenance import machine_sha256, package_versions
from tbm_gsa.reading import MachineFile
from tbm_gsa.sensitivity.study.inputs import Input, InputSet
from tbm_gsa.signals.conditioning import Frame
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.fields import Vector3

SEGMENT_S: Final = BandReading.segment_s
STEP: Final = 1.1
"""Factor on an input to either side, for the slopes."""
SIMILAR: Final = 0.9
"""Correlation from which on two inputs are named as a pair."""
FACTOR_REACH: Final = 3.0
"""Standard deviations of its logarithm by which a load's factor may move."""

Run = Callable[[Callable[[Machine], Array], Iterable[Machine]], Iterable[Array]]
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
    false_rate: float = 0.05
    probability: float = 0.9


def observability(
    machine: Machine,
    sensors: Sequence[SensorChoice],
    candidates: Sequence[SensorChoice] = (),
    settings: ObservationSettings | None = None,
    run: Run = map,
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
    spots = _spots(machine, sensors, candidates)
    equipped, reading = _equipped(machine, [spot for _, spot in spots.values()], list(spots))
    problem = _Problem.of(machine, equipped, reading, chosen, run)
    own = [name for name, (given, _) in spots.items() if given]
    before = problem.view(own)
    gains = [
        problem.gain(before, problem.view([*own, name]), spot) for name, (given, spot) in spots.items() if not given
    ]
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
        inputs={item.code: problem.input(before, k) for k, item in enumerate(problem.inputs.inputs)},
        loads=problem.loads(before),
        pairs=tuple(problem.pairs(before)),
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
    return equipped, BandReading({name: Sensor(spot.frame) for name, spot in zip(names, spots, strict=True)})


def _powers(reading: BandReading, factors: Array, machine: Machine) -> Array:
    """Band powers of a machine, (k,), without noise."""
    return load_transfer(machine, reading).predict(factors)


@dataclass(frozen=True, eq=False)
class _View:
    """What a set of sensors says; u statistics."""

    names: list[str]
    unused: list[str]
    inputs: Detection
    known_loads: Detection
    smallest: Array
    smallest_factors: Array


@dataclass(frozen=True, eq=False)
class _Problem:
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
        cls, machine: Machine, equipped: Machine, reading: BandReading, settings: ObservationSettings, run: Run
    ) -> _Problem:
        """Compute the machine with every input less and more."""
        prior = loads_prior(machine)
        inputs = explaining_inputs(machine)
        ends = np.array([_ends(item) for item in inputs.inputs]).T
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
        inputs = Detection.of(slopes, found.scatter, loads, prior.log_sigma)
        statistics = [statistic.name for statistic in motion.reading.statistics]
        return _View(
            names=[statistics[place] for place in used],
            unused=[name for place, name in enumerate(statistics) if place not in set(used.tolist())],
            inputs=inputs,
            known_loads=Detection.of(slopes, found.scatter, loads[:0], prior.log_sigma),
            smallest=inputs.smallest(chosen.false_rate, chosen.probability),
            smallest_factors=_each_load(loads, found.scatter, prior.log_sigma).smallest(
                chosen.false_rate, chosen.probability
            ),
        )

    def input(self, view: _View, place: int) -> ObservedInput:
        """Return what is seen of an input."""
        item, change = self.inputs.inputs[place], float(view.smallest[place])
        decrease, increase = _both_ways(
            change, math.log(item.initial / item.lower), math.log(item.upper / item.initial)
        )
        known = float(view.known_loads.information[place])
        return ObservedInput(
            name=item.name,
            unit=item.unit,
            value=item.initial,
            decrease=decrease,
            increase=increase,
            hidden_by_loads=1.0 - float(view.inputs.information[place]) / known if known else math.nan,
        )

    def loads(self, view: _View) -> dict[str, ObservedLoad]:
        """Return what is seen of the factors of the loads."""
        reach = FACTOR_REACH * self.prior.log_sigma
        found: dict[str, ObservedLoad] = {}
        for group, change in zip(LOAD_GROUPS, view.smallest_factors.tolist(), strict=True):
            decrease, increase = _both_ways(change, reach, reach)
            found[group] = ObservedLoad(value=getattr(self.prior, group), decrease=decrease, increase=increase)
        return found

    def found(self, view: _View) -> list[str]:
        """Codes of the inputs that can be found."""
        return [item.code for place, item in enumerate(self.inputs.inputs) if self.input(view, place).found]

    def pairs(self, view: _View) -> list[SimilarPair]:
        """Pair inputs that do nearly the same, the most similar first."""
        correlation, codes, found = view.inputs.correlation, self.inputs.codes, self.found(view)
        pairs = [
            SimilarPair(inputs=(codes[i], codes[j]), correlation=value, times=_times(value))
            for i, j in combinations(range(len(codes)), 2)
            if abs(value := float(correlation[i, j])) >= SIMILAR and {codes[i], codes[j]} <= set(found)
        ]
        return sorted(pairs, key=lambda pair: -abs(pair.correlation))

    def gain(self, before: _View, after: _View, spot: SensorSpot) -> SensorGain:
        """Return what one sensor more would add."""
        widths = [math.log(item.upper / item.lower) for item in self.inputs.inputs]
        prior = np.array(widths) / math.sqrt(12.0)  # of a uniform law
        seen, loads = set(self.found(before)), self.loads(before)
        seen_after = self.found(after)
        return SensorGain(
            **dict(spot),
            bits=after.inputs.bits(prior) - before.inputs.bits(prior),
            inputs=tuple(code for code in seen_after if code not in seen),
            loads=tuple(group for group, one in self.loads(after).items() if one.found and not loads[group].found),
            smaller={
                code: float(before.smallest[place] / after.smallest[place])
                for place, code in enumerate(self.inputs.codes)
                if code in seen and code in seen_after
            },
        )


def _ends(item: Input) -> tuple[float, float]:
    """Values of an input a step less and more, within its range."""
    if item.lower <= 0.0:
        raise InputError(f"input {item.code}: range from {item.lower:g}, allowed: positive values")
    return max(item.lower, item.initial / STEP), min(item.upper, item.initial * STEP)


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


def _each_load(loads: Array, chance: Array, sigma: float) -> Detection:
    """Return that of each group of loads while the others are free, of slopes (r, u)."""
    rows = [
        Detection.of(loads[[place]], chance, np.delete(loads, place, axis=0), sigma).moves
        for place in range(len(loads))
    ]
    return Detection(np.concatenate(rows))


def _both_ways(change: float, down: float, up: float) -> tuple[float, float]:
    """Relative decrease and increase that a logarithm's change is; NaN where it does not reach so far."""
    decrease = -math.expm1(-change) if change <= down else math.nan
    return decrease, math.expm1(change) if change <= up else math.nan


def _times(correlation: float) -> float:
    left = 1.0 - correlation**2
    return 1.0 / math.sqrt(left) if left > 0.0 else math.nan
