"""False alarms and delay of the alarm for a changed machine, in one run of `python benchmarks/machine_alarm.py`.

Every group of loads is simulated by itself, without the others, on the sound machine and on changed ones; the motion
under all of them is the sum, whatever their factors (teeth in contact: the machine is linear, and varies in time). Of
the spectra of these runs minutes are put together: of every group five blocks of twelve seconds, drawn by themselves,
times its factor at that time, and the noise of the sensors. The factors walk by a factor of two up and down, and jump.
Every history has its own baseline, of its first four hours.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.fft
import scipy.stats
from numpy.random import Generator, default_rng

from tbm_dynamics import Machine, Simulator, load_machine
from tbm_dynamics.integration import DEFAULT_STEP
from tbm_dynamics.loads.description import LOAD_GROUPS, LoadFactors
from tbm_gsa.explanation.band_reading import BandReading, Sensor
from tbm_gsa.explanation.cause_curves import cause_curves
from tbm_gsa.explanation.load_scatter import load_scatter
from tbm_gsa.explanation.load_transfer import machine_motion
from tbm_gsa.explanation.machine_state import CauseGrid
from tbm_gsa.explanation.machine_watch import MachineWatch
from tbm_gsa.explanation.rock_fit import RockModel
from tbm_gsa.explanation.sequential import MachineChart, commission
from tbm_gsa.signals.conditioning import causal_conditioner

START_S, SEGMENT_S, BLOCK, BLOCKS = 4.0, 4.0, 5, 5
COMMISSIONING, DAYS_30 = 240, 43_200  # minutes
LONGEST_DELAY = 240  # minutes
CHANGED = ",".join(f"x{number}" for number in range(16, 26))
LATER = 30  # minutes after the alarm
LEFT = 0.7
NOISE = (1e-4 * 9.81) ** 2  # m²/s⁴/Hz, of sensors of 100 µg/√Hz
CHUNK = 10_000


@dataclass(frozen=True, eq=False)
class Library:
    """Spectra of runs: complex amplitudes of segments that begin every two seconds.

    Attributes
    ----------
    parts : ndarray, shape (r + 2, n, f, o)
        Under each group of loads alone, the bins of all bands, the columns of all points; under the mean loads; noise.
    bins : tuple of slice
        Of each band.
    """

    parts: np.ndarray
    bins: tuple[slice, ...]

    @classmethod
    def of(cls, machine: Machine, reading: BandReading, minutes: float, seed: int) -> Library:
        """Simulate."""
        places, bins, first = [], [], 0
        for low, high in reading.bands:
            inside = np.arange(np.ceil(low * SEGMENT_S - 0.25), np.ceil(high * SEGMENT_S - 0.25)).astype(int)
            places.append(inside)
            bins.append(slice(first, first + len(inside)))
            first += len(inside)
        silent = dict.fromkeys((f"loads.{group}" for group in LOAD_GROUPS), 0.0)
        spectra = partial(_spectra, reading=reading, seconds=60.0 * minutes, seed=seed, places=np.concatenate(places))
        meshes = spectra(machine.with_inputs(**silent))
        alone = [spectra(machine.with_inputs(**{**silent, f"loads.{group}": 1.0})) - meshes for group in LOAD_GROUPS]
        random = default_rng(seed)
        noise = random.standard_normal((2, *meshes.shape)) * np.sqrt(0.5 * NOISE / SEGMENT_S)
        return cls(np.array([*alone, meshes, noise[0] + 1j * noise[1]], dtype=np.complex64), tuple(bins))

    def minute(self, factors: np.ndarray, gain: np.ndarray, random: Generator) -> np.ndarray:
        """Logarithms (k,) of the band powers of a minute; gain (o,) of the channels."""
        shares = [*factors.astype(np.float32), np.float32(1.0), np.float32(1.0)]
        starts = random.integers(self.parts.shape[1] - BLOCK, size=(BLOCKS, len(shares)))
        total = np.zeros(self.parts.shape[2:])
        for row in starts:
            sums = sum(
                share * part[start : start + BLOCK] for share, part, start in zip(shares, self.parts, row, strict=True)
            )
            total += (np.square(sums.real) + np.square(sums.imag)).sum(axis=0)
        total *= np.square(gain) / (BLOCKS * BLOCK)
        powers = np.array([total[part].sum(axis=0) for part in self.bins])
        return np.log(powers.T).ravel()


def _spectra(machine: Machine, reading: BandReading, seconds: float, seed: int, places: np.ndarray) -> np.ndarray:
    """Complex amplitudes (n, f, o) whose squares add up to mean squares."""
    nodes = [machine.description.test_points[point] for point in reading.sensors]
    simulator, loads = Simulator(machine.assemble(), nodes), machine.loads(seed)
    size, hop = round(SEGMENT_S / DEFAULT_STEP), round(0.5 * SEGMENT_S / DEFAULT_STEP)
    window = np.hanning(size + 1)[:-1]
    scale = np.sqrt(2.0 / (size * np.square(window).sum()))
    conditioner, waiting, found = (
        causal_conditioner(1.0 / DEFAULT_STEP, reading.band),
        np.empty((0, 3 * len(nodes))),
        [],
    )
    for first in range(0, round((START_S + seconds) / DEFAULT_STEP), CHUNK):
        moment = np.arange(first, first + CHUNK) * DEFAULT_STEP
        motion = simulator.step(loads.evaluate(moment)).acceleration[:, :, :3].reshape(len(moment), -1)
        values = conditioner.process(motion, motion.mean(axis=0))
        if moment[0] < START_S:
            continue
        waiting = np.vstack([waiting, values])
        while len(waiting) >= size:
            amplitudes = scale * scipy.fft.rfft(waiting[:size] * window[:, None], axis=0)[places]
            found.append(amplitudes.astype(np.complex64))
            waiting = waiting[hop:]
    return np.array(found)


def walk(random: Generator) -> Iterator[np.ndarray]:
    """Factors (r,), minute by minute: a walk between a half and two, with a jump of one group every four hours."""
    reach = np.log(2.0)
    logs = random.uniform(-reach, reach, len(LOAD_GROUPS))
    while True:
        logs = logs + 0.05 * random.standard_normal(len(logs))
        logs = np.where(np.abs(logs) > reach, np.sign(logs) * 2.0 * reach - logs, logs)
        if random.random() < 1.0 / 240.0:
            logs[random.integers(len(logs))] = random.uniform(-reach, reach)
        yield np.exp(logs)


@dataclass(frozen=True, eq=False)
class Trial:
    """A sound machine with its model."""

    sound: Library
    model: RockModel

    def chart(self, random: Generator, rock: Iterator[np.ndarray]) -> MachineChart:
        """Chart of a history that was commissioned."""
        even = np.ones(self.sound.parts.shape[3])
        minutes = [self.sound.minute(next(rock), even, random) for _ in range(COMMISSIONING)]
        return MachineChart(self.model, commission(self.model, minutes), DAYS_30)

    def false_alarms(self, seed: int, hours: int) -> tuple[int, float]:
        """Alarms that rise in so many hours after the commissioning, and the largest distance over its limit."""
        random = default_rng(seed)
        rock, even = walk(random), np.ones(self.sound.parts.shape[3])
        chart, before, alarms, largest = self.chart(random, rock), False, 0, 0.0
        for _ in range(60 * hours):
            point = chart.update(self.sound.minute(next(rock), even, random))
            alarms += point.signals and not before
            before, largest = point.signals, max(largest, point.distance / point.limit)
        return alarms, largest

    def found(self, changed: Library, gain: np.ndarray, grid: CauseGrid, seed: int) -> tuple[int, str]:
        """Minutes from the change, an hour after the commissioning, to the alarm; what it says half an hour later."""
        random = default_rng(seed)
        rock, even = walk(random), np.ones(self.sound.parts.shape[3])
        watch, delay, text = MachineWatch(self.model, grid), 0, ""
        for _ in range(COMMISSIONING + 60):
            watch.add(0, self.sound.minute(next(rock), even, random))
        for minute in range(1, LONGEST_DELAY + 1):
            state = watch.add(minute, changed.minute(next(rock), gain, random))
            if state.alarm is not None and not delay:
                delay, text = minute, state.alarm.text
            if delay and minute >= delay + LATER:
                best = max(state.inputs, key=lambda one: one.probability)
                size = f"{best.value:.2f} ({best.low:.2f} to {best.high:.2f})"
                return delay, f"{text}; later {best.name} {size}, {best.probability:.2f}"
        return delay or LONGEST_DELAY + 1, text


def prepare(minutes: float) -> tuple[Machine, BandReading, Trial]:
    """Sound machine of `dz101` with sensors at its five points."""
    machine = load_machine("dz101")
    reading = BandReading(
        {point: Sensor() for point in machine.description.test_points}, machine.description.loads.bands
    )
    noise = np.full(len(reading.statistics), NOISE)
    model = RockModel(load_scatter(machine_motion(machine, reading)), LoadFactors(), noise, 60.0)
    return machine, reading, Trial(Library.of(machine, reading, minutes, 1), model)


def main() -> None:
    """Print false alarms and delays."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--histories", type=int, default=20)
    options.add_argument("--hours", type=int, default=50, help="of every history, without its commissioning")
    options.add_argument("--trials", type=int, default=6, help="of every change")
    options.add_argument("--changed", default=CHANGED, help="inputs that lose 30 %% each")
    options.add_argument("--minutes", type=float, default=12.0, help="of every simulated run")
    options.add_argument("--workers", type=int, default=1)
    given = options.parse_args()
    machine, reading, trial = prepare(given.minutes)
    with ProcessPoolExecutor(given.workers) as pool:
        found = []
        for one in pool.map(trial.false_alarms, range(given.histories), [given.hours] * given.histories):
            found.append(one)
            print(f"history {len(found)}: {one[0]} alarms, largest distance over its limit {one[1]:.2f}", flush=True)
    if found:
        alarms, hours = sum(count for count, _ in found), given.histories * given.hours
        upper = scipy.stats.chi2.ppf(0.95, 2 * alarms + 2) / 2.0
        print(f"{hours} h without a change: {alarms} false alarms, {alarms * 720.0 / hours:.2f} in 30 days, ", end="")
        print(f"below {upper * 720.0 / hours:.2f} at 95 %")
    grid, even = CauseGrid.of(cause_curves(machine, reading, given.workers)), np.ones(trial.sound.parts.shape[3])
    for code in given.changed.split(","):
        changed = Library.of(machine.with_inputs(**{code: LEFT}), reading, 0.25 * given.minutes, 2)
        report(f"{code} = {LEFT:g}", [trial.found(changed, even, grid, seed) for seed in range(given.trials)])
    for size in (1.1, 1.5, 1000.0, 1.0 / 1.5):
        gain = even.copy()
        gain[3:6] = size
        report(f"shield times {size:.3g}", [trial.found(trial.sound, gain, grid, seed) for seed in range(given.trials)])


def report(what: str, found: list[tuple[int, str]]) -> None:
    """Print the delays of one change, and what the alarms say."""
    delays = ", ".join("–" if delay > LONGEST_DELAY else str(delay) for delay, _ in sorted(found))
    print(f"{what:20s} {delays}", *(f"    {text}" for _, text in found), sep="\n", flush=True)


if __name__ == "__main__":
    main()
