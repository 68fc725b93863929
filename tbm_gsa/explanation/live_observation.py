"""Band powers that were measured since a change began, as a document: what an explanation of an alarm works on."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Self

import numpy as np

from tbm_dynamics import Machine, load_machine
from tbm_gsa.comparison.results import OperatingLevel
from tbm_gsa.explanation.live_reading import LiveReading
from tbm_gsa.explanation.load_posterior import BandObservation
from tbm_gsa.explanation.observed import FEWEST_POINTS, Observed
from tbm_gsa.explanation.training import CurveJob
from tbm_gsa.explanation.workflow import ExplanationSource
from tbm_gsa.provenance import machine_file, machine_sha256
from tbm_gsa.reading import MachineFile, Part, RecordingFile, read_document
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py.base.arrays import Array

FILE_NAME, PAGE_NAME = "observed.json", "explanation.html"
"""In the folder of an alarm: this document, and the page of its explanation."""


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
    """

    machine_file: MachineFile
    job: CurveJob
    live: LiveReading
    powers: tuple[float, ...]
    floor: tuple[float, ...]
    measured: tuple[int, ...]
    seconds: float

    @classmethod
    def of(
        cls, machine: Machine, job: CurveJob, live: LiveReading, rows: Iterable[Array], floor: Array, span_s: float
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
        bands = BandObservation(powers, noise, self.seconds)
        return Observed(reading, bands, np.array(self.floor), np.array(self.measured, dtype=np.int64))


def observed_source(file: Path) -> ExplanationSource:
    """Read what is to be explained.

    Raises
    ------
    StudyError
        A machine file that has changed since, or no such document.
    """
    found = read_document(file, LiveObservation, f"the {FILE_NAME} of an alarm", StudyError)
    machine = load_machine(found.job.machine)
    if machine_sha256(machine) != found.machine_file.sha256:
        raise StudyError(f"machine {found.job.machine} has changed since the alarm")
    job = found.job
    level = OperatingLevel(
        speed_r_min=job.speed_r_min,
        torque_kn_m=job.torque_kn_m,
        thrust_kn=job.thrust_kn,
        seconds=found.seconds,
        source="recording",
        note="measured live",
    )
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    recording = RecordingFile(path=str(file), sha256=digest)
    return ExplanationSource(found.observed(), job.variant(machine), recording, found.machine_file, level)
