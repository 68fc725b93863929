"""Explanation of an alarm from the band powers that were measured since the change, in a process of its own."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

from tbm_dynamics import load_machine
from tbm_gsa.app.report.explanation_page import write_explanation_page
from tbm_gsa.comparison.results import OperatingLevel
from tbm_gsa.explanation.live_observation import FILE_NAME, LiveObservation
from tbm_gsa.explanation.result import PAGE_NAME
from tbm_gsa.explanation.workflow import ExplainOptions, ExplanationSource, explain_source
from tbm_gsa.provenance import machine_sha256
from tbm_gsa.reading import RecordingFile, read_document
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py.base.errors import InputError


def main() -> int:
    """Explain what is in the folder of the first argument, with as many processes as the second says."""
    folder = Path(sys.argv[1])
    try:
        found = explain_source(observed_source(folder / FILE_NAME), folder, ExplainOptions(workers=int(sys.argv[2])))
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    write_explanation_page(found, folder / PAGE_NAME)
    sys.stderr.write(f"{found.sentence()}\n")
    return 0


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
    recording = RecordingFile(path=str(file), sha256=digest, begin=found.begin)
    return ExplanationSource(found.observed(), job.variant(machine), recording, found.machine_file, level)
