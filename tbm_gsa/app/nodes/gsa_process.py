"""One sensitivity analysis at a time, after the explanation of an alarm, in processes that the node only watches."""

from __future__ import annotations

import math
import os
import signal
import sqlite3
import time
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from tbm_gsa.app.nodes.settings import GsaSettings
from tbm_gsa.app.nodes.start import child_command
from tbm_gsa.explanation.live_observation import FILE_NAME, LiveObservation
from tbm_gsa.explanation.result import PAGE_NAME
from tbm_gsa.sensitivity.results import REPORT_NAME, RESULT_NAME, StudyResult
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.store import STORE_NAME, Store
from tbm_msgs_py.base.files import write_whole
from tbm_msgs_py.nodes.processes import ChildProcess

State = Literal["idle", "running", "finished", "failed", "cancelled"]
Step = Literal["explanation", "study"]
_LOG_NAMES: dict[Step, str] = {"explanation": "explanation.log", "study": "gsa.log"}
_PRIORITY = 10  # of the study and its workers: they give way to the nodes, whatever priority those have
_GRACE_S = 1.0  # a node has 3 s to end, its study included


@dataclass(frozen=True)
class GsaStatus:
    """Where an analysis stands.

    Attributes
    ----------
    state : str
    reason : str
        What started it, or why it failed.
    done, total, failed : int
        Simulations.
    folder : Path or None
    step : {"explanation", "study"}
        That runs, or ran last.
    explanation : str
        What the explanation found, or why it did not; empty without one.
    """

    state: State = "idle"
    reason: str = ""
    done: int = 0
    total: int = 0
    failed: int = 0
    folder: Path | None = None
    step: Step = "study"
    explanation: str = ""

    @property
    def report(self) -> Path | None:
        """The HTML page of a finished analysis."""
        return self.folder / REPORT_NAME if self.folder and self.state == "finished" else None

    @property
    def explanation_page(self) -> Path | None:
        """The HTML page of an explanation."""
        page = self.folder / PAGE_NAME if self.folder and self.explanation else None
        return page if page and page.is_file() else None


@dataclass
class GsaProcess:
    """Starts, watches and cancels the process; store and report stay when this object is gone.

    Attributes
    ----------
    machine : str
    options : GsaSettings
    status : GsaStatus
    """

    machine: str
    options: GsaSettings
    status: GsaStatus = GsaStatus()
    _started: float = -math.inf  # s, monotonic
    _process: ChildProcess | None = field(default=None, repr=False)

    @property
    def running(self) -> bool:
        """Whether an analysis is under way."""
        return self.status.state == "running"

    def start(self, reason: str, pause: float = 0.0, observed: LiveObservation | None = None) -> str:
        """Start an analysis in a new folder; why it was not, empty if it was.

        Parameters
        ----------
        reason : str
        pause : float
            Least time since the start of the last one, min: an error close to the threshold starts no end of them.
        observed : LiveObservation, optional
            What is explained first.
        """
        passed = (time.monotonic() - self._started) / 60.0
        if passed < pause:
            return f"the last one began {passed:.0f} min ago, gsa.pause is {pause:g} min"
        if self.running:
            return "one is running already"
        try:
            self._start(reason, observed)
        except OSError as error:
            return str(error)
        return ""

    def _start(self, reason: str, observed: LiveObservation | None) -> None:
        folder = _new_folder(Path(self.options.folder).resolve())
        if observed is None:
            self._run("study", self._study(folder), folder)
        else:
            write_whole(folder / FILE_NAME, observed.model_dump_json().encode())
            module = "tbm_gsa.app.nodes.alarm_explanation"
            self._run("explanation", child_command(module, str(folder), str(self.options.workers)), folder)
        total = self.options.samples + self.options.test
        step: Step = "study" if observed is None else "explanation"
        self._started = time.monotonic()
        self.status = GsaStatus("running", reason, 0, total, 0, folder, step)

    def _study(self, folder: Path) -> list[str]:
        """Command of a study with the present options."""
        options = self.options
        command = child_command("tbm_gsa.app.cli.main", "gsa", "run", "--json", "--machine", self.machine)
        command += ["--samples", str(options.samples), "--test", str(options.test), "--out", str(folder)]
        command += ["--duration", str(options.duration), "--seed", str(options.seed), "--workers", str(options.workers)]
        command += ["--quick"] * options.quick + ["--common-loads"] * options.common_loads
        if options.inputs:
            command += ["--inputs", str(Path(options.inputs).resolve())]
        if options.outputs:
            command += ["--outputs", ",".join(options.outputs)]
        return command

    def _run(self, step: Step, command: list[str], folder: Path) -> None:
        # It ends with the node, so that a node that was killed leaves nothing running behind.
        self._process = ChildProcess(command, folder / _LOG_NAMES[step], results=False)
        os.setpriority(os.PRIO_PROCESS, self._process.pid, _PRIORITY)

    def poll(self) -> None:
        """Update the status from the process and its store."""
        if not self.running or self._process is None or self.status.folder is None:
            return
        code = self._process.poll()
        if self.status.step == "explanation":
            if code is not None:
                self._go_on(code, self._process.last_line(), self.status.folder)
            return
        done, failed = _counts(self.status.folder / STORE_NAME)
        # A signal while it still imports ends it with code 0, too.
        finished = code == 0 and (self.status.folder / RESULT_NAME).is_file()
        state: State = "running" if code is None else "finished" if finished else "failed"
        reason = f"{_end(code)}: {self._process.last_line()}" if state == "failed" else self.status.reason
        self.status = replace(self.status, state=state, reason=reason, done=done, failed=failed)

    def _go_on(self, code: int, said: str, folder: Path) -> None:
        """Start the study after an explanation, however that ended."""
        said = said if code == 0 else f"failed: {said}"
        self.status = replace(self.status, step="study", explanation=said)
        try:
            self._run("study", self._study(folder), folder)
        except OSError as error:
            self.status = replace(self.status, state="failed", reason=str(error))

    def result(self) -> StudyResult:
        """Read the result of a finished analysis."""
        assert self.status.folder is not None  # noqa: S101 - finished has a folder
        return StudyResult.read(self.status.folder / RESULT_NAME)

    def cancel(self, reason: str) -> bool:
        """End the running analysis, what it has simulated stays in its store; or accept one that failed."""
        if self.status.state == "failed":
            self.status = replace(self.status, state="cancelled", reason=f"{reason}; it had {self.status.reason}")
            return True
        if not self.running or self._process is None:
            return False
        self._process.end(_GRACE_S)
        self.status = replace(self.status, state="cancelled", reason=reason)
        return True


def _new_folder(parent: Path) -> Path:
    """Make a folder named after the time, numbered when two fall into one second."""
    stamp = datetime.now(UTC).strftime("gsa_%Y%m%dT%H%M%S")
    for number in range(1000):
        folder = parent / (f"{stamp}_{number}" if number else stamp)
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        return folder
    raise OSError(f"{parent}: no free folder name for {stamp}")


def _counts(store: Path) -> tuple[int, int]:
    """Finished and failed simulations; zero until the process has made its store."""
    if not store.is_file():
        return 0, 0
    try:
        with Store.open(store) as opened:
            counts = opened.counts()
    except (StudyError, sqlite3.Error):  # caught between creation and the first transaction, or locked
        return 0, 0
    return counts.done, counts.failed


def _end(code: int | None) -> str:
    """How a process ended that did not end well."""
    return f"killed by {signal.Signals(-code).name}" if code and code < 0 else f"exit code {code}"
