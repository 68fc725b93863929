"""What the page asks for beside what it is shown; called in threads of the server."""

from __future__ import annotations

import sqlite3
import time
from functools import cached_property
from pathlib import Path
from threading import Lock

from tbm_dynamics import Machine
from tbm_gsa.app.web.pages import PageFolder
from tbm_gsa.app.web.spectra import LiveSpectra
from tbm_gsa.app.web.state import Acknowledgement, PageList, Waterfall
from tbm_gsa.history import History
from tbm_gsa.history.event_list import ListedEvent
from tbm_msgs_py.base.errors import InputError


class MachineSite:
    """The page of one machine.

    Parameters
    ----------
    machine : Machine
    spectra : LiveSpectra
    folder : Path
        Of the pages that are linked.
    history : Path or None
        In which events are acknowledged; None: nobody may.
    lock : Lock
        Held while the history is open, as `TrendReader` has it.
    """

    def __init__(self, machine: Machine, spectra: LiveSpectra, folder: Path, history: Path | None, lock: Lock) -> None:
        self._machine, self._spectra, self._history, self._lock = machine, spectra, history, lock
        self._pages = PageFolder(folder)

    def waterfall(self, point: str) -> Waterfall:
        """Rows of the last minutes."""
        return self._spectra.waterfall(point)

    def drawing(self) -> bytes:
        """Drawing of the machine with all its nodes, SVG."""
        return self._drawing

    @cached_property
    def _drawing(self) -> bytes:
        from tbm_gsa.app.report.machine_drawing import draw_machine  # noqa: PLC0415 - matplotlib, for those who ask
        from tbm_gsa.app.report.picture import drawn  # noqa: PLC0415

        return drawn(draw_machine(self._machine), ".svg")

    def pages(self) -> PageList:
        """Pages of studies, explanations and comparisons."""
        return self._pages.find()

    def page(self, key: str) -> str | None:
        """Content of one of them."""
        return self._pages.read(key)

    def acknowledge(self, asked: Acknowledgement) -> ListedEvent:
        """Acknowledge an event, as `tbm-monitor events ack` does."""
        if self._history is None:
            raise InputError("this page acknowledges nothing, allowed: `tbm-monitor events ack`")
        try:
            with self._lock, History(self._history, create=False) as history:
                (seen,) = history.acknowledge(
                    [asked.id], asked.by, asked.comment, time.time_ns(), replace=asked.replace
                )
        except sqlite3.Error as error:
            raise InputError(f"{self._history}: {error}") from None
        return ListedEvent.of(seen)
