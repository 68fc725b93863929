"""A machine whose band powers add, as curves on a disk, and minutes of its signals drawn from its law."""

from concurrent.futures import Executor, Future
from dataclasses import replace

import numpy as np
from numpy.random import default_rng

from tbm_dynamics import load_machine
from tbm_gsa.explanation.band_reading import BandReading, Sensor
from tbm_gsa.explanation.cause_curves import CauseCurves, CurveTable
from tbm_gsa.explanation.load_scatter import LoadScatter
from tbm_gsa.explanation.load_transfer import LoadTransfer
from tbm_gsa.sensitivity.study.distributions import LogUniform
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, InputSet
from tbm_gsa.signals.conditioning import Band
from tbm_gsa.signals.spans import SpanSpectrum
from tbm_gsa.signals.spectrum import SpectrumSum
from tbm_msgs_py.recordings.mapping import contract_sensor

MINUTE = 60 * 10**9
START = 28_333_333 * MINUTE
POINTS = ("cutterhead", "shield", "girder")
SENSORS = {point: contract_sensor(point) for point in POINTS}
RATE, GROUPS, SEGMENTS = 500.0, 6, 29
BANDS = tuple(band for band in load_machine("dz101").description.loads.bands if band[1] <= 0.4 * RATE)
READING = BandReading({point: Sensor() for point in POINTS}, BANDS, RATE, Band(0.5, 0.4 * RATE))


def curves(reading):
    """Two groups of loads move all statistics, input x22 some of them."""
    count = len(reading.statistics)
    gain = np.zeros((GROUPS, count))
    gain[:2] = np.exp(default_rng(5).normal(0.0, 1.0, (2, count)))
    falling = np.zeros((GROUPS + 2, GROUPS + 2, count, count))
    for place in range(count):
        falling[:2, :2, place, place] = np.outer(gain[:2, place], gain[:2, place]) / 10.0
    transfer = LoadTransfer(reading.statistics, gain, np.zeros_like(gain), np.full(count, 0.01))
    scatter = LoadScatter(transfer, falling, np.zeros((GROUPS, GROUPS, count, count)), reading.widths, 4.0)
    unit, moved = np.linspace(0.0, 1.0, 5), np.zeros(count)
    moved[1::4] = 1.5
    along = np.exp(np.outer(unit - 0.5, moved))[:, None]
    spread = np.sqrt(np.diagonal(falling[range(GROUPS), range(GROUPS)], axis1=1, axis2=2))
    table = CurveTable(unit, along * gain, np.zeros((5, GROUPS, count)), np.full((5, count), 0.01), along * spread)
    item = replace(PAPER_INPUTS["x22"], initial=1.0, distribution=LogUniform(1.0 / 3.0, 3.0))
    return CauseCurves(InputSet((item,)), scatter, {"x22": table})


class Minutes:
    """Spectra of minutes, one after the other, of points with sensors that measure white noise within each band."""

    def __init__(self, seed=0):
        self._random, self._scatter = default_rng(seed), curves(READING).nominal
        self.number = 0

    def __call__(self, gain=None, points=POINTS):
        """The next minute, as a live comparison gives it; sensors have gains by point."""
        size, start = round(4.0 * RATE), START + self.number * MINUTE
        self.number += 1
        factors, noise = np.ones(GROUPS), np.zeros(len(self._scatter.width))
        chance = np.diag(self._scatter.covariance(factors, noise, 60.0))
        powers = self._scatter.expected(factors, noise) * self._random.chisquare(2.0 / chance) * 0.5 * chance
        frequency, found = np.arange(size // 2 + 1) * 0.25, {}
        for point, rows in zip(POINTS, powers.reshape(len(POINTS), 3, len(BANDS)), strict=True):
            density = np.full((len(frequency), 3), 1e-9)
            for place, (low, high) in enumerate(BANDS):
                inside = (frequency + 0.0625 >= low) & (frequency + 0.0625 < high)
                density[inside] = rows[:, place] / (0.25 * inside.sum())
            total = SpectrumSum(SEGMENTS * density * (gain or {}).get(point, 1.0) ** 2, SEGMENTS, size)
            found[point] = [SpanSpectrum(start, MINUTE, RATE, Band(0.5, 0.4 * RATE), total)]
        return {point: found[point] for point in points}


class AtOnce(Executor):
    """Does a task when it is handed over."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - a task may raise anything
            future.set_exception(error)
        return future
