"""Calibration of `gsa explain`: recordings of known causes, one run of `python benchmarks/explanation.py`.

Every recording is a run of dz101 of a minute with loads of its own, conditioned and read as a comparison does, with
sensors of 100 µg/√Hz whose noise is not stated and that lose packets. Prints the true causes against the verdicts, how
often probabilities and intervals are right, and every miss; `--keep FILE` keeps the band powers, so that another run
only judges them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from tbm_dynamics import Machine, Simulator, load_machine
from tbm_dynamics.integration import DEFAULT_STEP
from tbm_dynamics.loads.description import LOAD_GROUPS
from tbm_dynamics.machine.description import MachineDescription
from tbm_gsa.explanation.band_reading import BandReading, Sensor
from tbm_gsa.explanation.cause_curves import CauseCurves
from tbm_gsa.explanation.curve_cache import cached_curves
from tbm_gsa.explanation.hypotheses import VERDICTS, with_gain
from tbm_gsa.explanation.judgement import judge
from tbm_gsa.explanation.load_scatter import load_scatter
from tbm_gsa.explanation.load_transfer import machine_motion
from tbm_gsa.explanation.observed import Observed
from tbm_gsa.explanation.ranges import explaining_inputs
from tbm_gsa.signals.noise_floor import noise_floor
from tbm_gsa.signals.reduction import SignalReducer
from tbm_gsa.signals.settings import Settings

START_S, RUN_S, CHUNK, NOISE = 3.0, 60.0, 10_000, 100e-6 * 9.80665
PACKET, LOST = 1000, (0.01, 0.005, 0.005, 0.01, 0.02)
"""Samples of a packet, and share of them that the sensor of each test point loses."""
SURE = 0.8
SINGLE, ROCK, NOTHING, GAIN, DEAD, MASS, PAIRS = 60, 24, 6, 6, 4, 5, 8


@dataclass(frozen=True)
class Case:
    """One recording: what was changed, by how much."""

    kind: str
    inputs: tuple[tuple[str, float], ...] = ()
    channel: tuple[int, int] = (0, 0)
    factor: float = 1.0

    def __str__(self) -> str:
        changed = ", ".join(f"{code} = {value:.3g}" for code, value in self.inputs)
        return f"{self.kind} {changed or f'{self.factor:.3g} {self.channel}'}"


@cache
def own() -> tuple[Machine, BandReading]:
    """Machine and reading of all cases."""
    machine = load_machine("dz101")
    return machine, BandReading(
        {point: Sensor() for point in machine.description.test_points}, machine.description.loads.bands
    )


def cases() -> Iterator[Case]:
    """All of them, from one seed."""
    rng, machine = np.random.default_rng(19), own()[0]
    inputs = explaining_inputs(machine).inputs
    for number in range(SINGLE):
        item = inputs[number % len(inputs)]
        yield Case("single", ((item.code, float(item.distribution.from_unit(rng.uniform()))),))
    for number in range(ROCK):
        chosen = rng.permutation(LOAD_GROUPS)[: 1 + number % 3]
        yield Case("rock", tuple((f"loads.{group}", float(2.0 ** rng.uniform(-1.0, 1.0))) for group in chosen))
    yield from [Case("nothing")] * NOTHING
    for number in range(GAIN):
        yield Case("gain", (), (number % 5, int(rng.integers(3))), 1.1 if number % 2 else 0.9)
    for number in range(DEAD):
        yield Case("dead", (), (number % 5, int(rng.integers(3))), 0.0)
    yield from [Case("mass", (), (0, 0), factor) for factor in np.linspace(1.05, 1.4, MASS).tolist()]
    for _ in range(PAIRS):
        pair = rng.permutation([f"x{number}" for number in (16, 17, 18, 19, 20, 21, 22, 25)])[:2]
        yield Case("pair", tuple((str(code), float(3.0 ** rng.uniform(-0.7, 0.7))) for code in pair))


def changed_machine(case: Case) -> Machine:
    """Machine of a case."""
    machine = own()[0]
    if case.kind != "mass":
        return machine.with_inputs(**dict(case.inputs))
    raw = machine.base.model_dump()
    raw["cutterhead_bearing_gear"]["shafts"][0]["mass"] *= case.factor
    return Machine(MachineDescription.model_validate(raw))


def recording(numbered: tuple[int, Case]) -> np.ndarray:
    """Band powers, noise floors and coverage, (3, k)."""
    (seed, case), (_, reading) = numbered, own()
    machine, rng = changed_machine(case), np.random.default_rng(seed)
    nodes = [machine.description.test_points[point] for point in reading.sensors]
    simulator, loads = Simulator(machine.assemble(), nodes), machine.loads(seed)
    reducers = [SignalReducer(reading.rate_hz, reading.band, "fixed", Settings()) for _ in nodes]
    size = NOISE * np.sqrt(0.5 / DEFAULT_STEP)
    for first in range(0, round((START_S + RUN_S) / DEFAULT_STEP), CHUNK):
        moment = np.arange(first, first + CHUNK) * DEFAULT_STEP
        values = simulator.step(loads.evaluate(moment)).acceleration[:, :, :3]
        values[:, case.channel[0], case.channel[1]] *= 1.0 if case.kind == "mass" else case.factor
        values = values + size * rng.standard_normal(values.shape)
        if moment[0] >= START_S:
            for place, reducer in enumerate(reducers):
                kept = np.repeat(rng.random(CHUNK // PACKET) >= LOST[place], PACKET)
                reducer.feed(moment[kept] - START_S, np.ascontiguousarray(values[kept, place]))
    signals = {point: reducer.finish() for point, reducer in zip(reading.sensors, reducers, strict=True)}
    floors = np.concatenate([noise_floor(signal) for signal in signals.values()])
    segments = np.array([signal.spectra[0].segments for signal in signals.values()])
    share = 0.5 * reading.segment_s * (segments + 1.0) / RUN_S
    counts = 3 * len(reading.bands), len(reading.bands)
    return np.array([reading.of(signals), np.repeat(floors, counts[1]), np.repeat(share, counts[0])])


def drawn(numbered: tuple[int, Case]) -> np.ndarray:
    """Band powers, noise and coverage, (3, k), with the mean and the covariance of a minute of the case's machine."""
    (seed, case), (_, reading) = numbered, own()
    scatter = load_scatter(machine_motion(changed_machine(case), reading))
    if case.kind in ("gain", "dead"):
        name = list(reading.sensors)[case.channel[0]], "xyz"[case.channel[1]]
        here = np.array([(one.point, one.axis) == name for one in reading.statistics])
        scatter = with_gain(scatter, here, case.factor)
    factors = dict.fromkeys(LOAD_GROUPS, 1.0) | {
        code.removeprefix("loads."): value for code, value in case.inputs if code.startswith("loads.")
    }
    level, noise = np.array(list(factors.values())), np.full(len(scatter.width), NOISE**2)
    chance = scatter.covariance(level, noise, RUN_S)
    logs = np.random.default_rng(seed).multivariate_normal(np.zeros(len(noise)), chance, method="svd")
    return np.array([scatter.expected(level, noise) * np.exp(logs - 0.5 * np.diag(chance)), noise, np.ones_like(noise)])


@dataclass(frozen=True)
class Outcome:
    """What was found of a case: `inside` is whether the 90 % interval of the changed input holds its value."""

    case: Case
    verdict: str
    named: str
    probability: float
    words: dict[str, float]
    blind: bool
    inside: bool | None
    misfit: float

    @property
    def right(self) -> bool:
        """Whether the verdict is what was done."""
        case = self.case
        if case.kind == "single":
            return self.named == f"input {case.inputs[0][0]}"
        if case.kind in ("gain", "dead"):
            return self.named == f"{case.kind} {list(own()[1].sensors)[case.channel[0]]}_{'xyz'[case.channel[1]]}"
        return self.verdict == {"rock": "rock", "nothing": "rock"}.get(case.kind, "not explained")

    @property
    def sure(self) -> bool:
        """Whether an input is named with much probability."""
        return self.verdict == "machine" and self.probability >= SURE


def judged(case: Case, bands: np.ndarray) -> Outcome:
    """Judge a recording."""
    (machine, reading), (powers, floor, coverage) = own(), bands
    seen = Observed.of(reading, powers, floor, np.full(len(powers), np.nan), RUN_S, coverage)
    found = judge(seen, curves(), machine.description.loads.factors)
    chosen, inside = found.chosen, None
    code, value = case.inputs[0] if case.kind == "single" else ("", 0.0)
    for one in found.findings:
        if code and one.hypothesis.name == code:
            low, _, high = found.curves.inputs[code].distribution.from_unit(one.quantiles)
            inside = bool(low <= value <= high)
    return Outcome(
        case=case,
        verdict=found.verdict,
        named="nothing" if found.verdict == "not explained" else f"{chosen.hypothesis.kind} {chosen.hypothesis.name}",
        probability=found.probability,
        words={word: round(share, 3) for word, share in found.words.items()},
        blind=code in found.blind,
        inside=inside,
        misfit=chosen.best.misfit / chosen.best.freedom,
    )


@cache
def curves() -> CauseCurves:
    """Curves of the machine."""
    return cached_curves(*own())


def report(found: list[Outcome]) -> None:
    """Print the tables."""
    print(f"\n{'':10s}" + "".join(f"{word:>15s}" for word in (*VERDICTS, "right")))
    for kind in dict.fromkeys(one.case.kind for one in found):
        of = [one for one in found if one.case.kind == kind]
        counts = [*(sum(one.verdict == word for one in of) for word in VERDICTS), sum(one.right for one in of)]
        print(f"{kind:10s}" + "".join(f"{count:15d}" for count in counts))
    sure = [one for one in found if one.sure]
    wrong = [one for one in sure if not one.right]
    print(f"\nan input named with {SURE:g} or more: {len(sure)}, of these wrong {len(wrong)}")
    looked = [one for one in found if one.inside is not None]
    for words, chosen in (("looked at", looked), ("found", [one for one in looked if one.right])):
        print(f"value in the interval of the changed input, {words}: {sum(map(_held, chosen))} of {len(chosen)}")
    misfits = [one.misfit for one in found if one.named != "nothing"]
    print(f"misfit per degree of freedom of what is explained: {np.mean(misfits):.2f}")
    print("\nnot right:")
    for one in found:
        if not one.right:
            blind = ", cannot be told" if one.blind else ""
            named = f"{one.named} {one.probability:.2f}, misfit {one.misfit:.2f}"
            print(f"  {one.case}{blind}: {one.verdict}, {named}; {one.words}")


def _held(one: Outcome) -> bool:
    return bool(one.inside)


def main() -> None:
    """Make or read the recordings, judge them, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", type=Path, help="file of band powers, made if it is not there")
    parser.add_argument("--drawn", action="store_true", help="draw band powers from their law instead of runs: seconds")
    chosen = parser.parse_args()
    every, start = list(cases()), time.perf_counter()
    curves()
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        if chosen.keep and chosen.keep.exists():
            recordings = list(np.load(chosen.keep))
        else:
            recordings = list(pool.map(drawn if chosen.drawn else recording, enumerate(every, 1000)))
            if chosen.keep:
                np.save(chosen.keep, np.array(recordings))
        print(f"{len(recordings)} recordings, {time.perf_counter() - start:.0f} s", flush=True)
        found = list(pool.map(judged, every, recordings))
    print(f"judged, {time.perf_counter() - start:.0f} s")
    report(found)


if __name__ == "__main__":
    main()
