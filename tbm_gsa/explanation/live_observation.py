"""Band powers that were measured since a change began, as a document: what an explanation of an alarm works on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Self

import numpy as np

from tbm_dynamics import Machine
from tbm_gsa.explanation.live_reading import LiveReading
from tbm_gsa.explanation.load_posterior import BandObservation
from tbm_gsa.explanation.observed import FEWEST_POINTS, Observed
from tbm_gsa.explanation.training import CurveJob
from tbm_gsa.provenance import machine_file
from tbm_gsa.reading import Begin, MachineFile, Part
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.units import iso_time

FILE_NAME = "observed.json"
"""In the folder of an alarm, beside its explanation."""


class LiveObservation(Part):
    """Mean band powers of some spans of time; k statistics.

    Attributes
    ----------
    machine_file : MachineFile
    job : CurveJob
        The level of operation.
    live : LiveReading
    powers, floor : tuple of float, k
        (m/s²)², 0 of statistics that were not measured, and the noise as the latest span shows it, m²/s⁴/Hz.
    measured : tuple of int
        Statistics that were measured.
    seconds : float
    begin : str
        Of the first span, ISO 8601 in UTC; an earlier version wrote none.
    """

    machine_file: MachineFile
    job: CurveJob
    live: LiveReading
    powers: tuple[float, ...]
    floor: tuple[float, ...]
    measured: tuple[int, ...]
    seconds: float
    begin: Begin = ""

    @classmethod
    def of(
        cls,
        machine: Machine,
        job: CurveJob,
        live: LiveReading,
        rows: Iterable[Array],
        floor: Array,
        span_s: float,
        begin_ns: int,
    ) -> Self:
        """From the logarithms (u,) of the used band powers of spans, NaN of one that was not measured."""
        used, logs = np.array(live.used), np.array(list(rows))
        known = np.isfinite(logs).any(axis=0)
        powers = np.zeros(len(live.noise))
        powers[used[known]] = np.nanmean(np.exp(logs[:, known]), axis=0)
        return cls(
            machine_file=machine_file(machine),
            job=job,
            live=live,
            powers=tuple(powers.tolist()),
            floor=tuple(floor.tolist()),
            measured=tuple(used[known].tolist()),
            seconds=span_s * len(logs),
            begin=iso_time(begin_ns),
        )

    def observed(self) -> Observed:
        """Return the band powers as an explanation takes them.

        Raises
        ------
        StudyError
            One test point.
        """
        reading, noise = self.live.reading, np.array(self.live.noise)
        if len(reading.sensors) < FEWEST_POINTS:
            raise StudyError(
                f"a verdict needs {FEWEST_POINTS} test points, for of one nothing tells the machine from its sensor; "
                f"measured: {', '.join(reading.sensors)}"
            )
        powers = np.maximum(self.powers, reading.widths * noise)
        bands = BandObservation(powers, noise, self.seconds, np.array(self.live.coverage))
        floor = np.full(len(noise), np.nan)
        floor[list(self.measured)] = np.array(self.floor)[list(self.measured)]
        return Observed(reading, bands, floor)
