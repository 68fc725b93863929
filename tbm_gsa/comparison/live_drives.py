"""The drives while they arrive: windows of the field's, held against the model's of the same time."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np

from tbm_dynamics import Machine
from tbm_gsa.comparison.drive_moments import LEAST_SAMPLES, DriveMoments, drive_moments
from tbm_gsa.comparison.drive_results import DrivesResult
from tbm_gsa.comparison.drive_sides import FieldDrives, field_drives, recorder_filter
from tbm_gsa.comparison.drives import compare_drives
from tbm_gsa.comparison.levels import machine_history
from tbm_gsa.comparison.streams import Side
from tbm_gsa.signals.clock import sampling_rate
from tbm_gsa.signals.settings import Settings
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.causal_filter import CausalFilter
from tbm_msgs_py.base.drive_state import DriveState
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.recordings.drives import DriveRecord, drive_record
from tbm_msgs_py.recordings.mapping import DriveMapping

MOST_SAMPLES: Final = 60_000
"""Of a side that may wait, ten minutes of the model's."""
_LEAST_OF_MODEL: Final = 2  # samples that a rate is taken from
Rows: TypeAlias = Sequence[tuple[int, Array]]


@dataclass(frozen=True)
class DriveWindow:
    """A window of the drives: begin and end (ns), and what it says, or why it says nothing."""

    begin_ns: int
    end_ns: int
    result: DrivesResult | None
    problem: str = ""


class LiveDrives:
    """Collects both sides and compares a window once both have it.

    A window is as long as those of the accelerometers, or as `LEAST_SAMPLES` of the field take.

    Parameters
    ----------
    machine : Machine
    mapping : DriveMapping
        How the field's are recorded.
    window_s : float

    Attributes
    ----------
    seen : bool
        Whether anything of the field has come.
    """

    def __init__(self, machine: Machine, mapping: DriveMapping, window_s: float) -> None:
        self._machine, self._mapping, self._settings = machine, mapping, Settings(window_s=window_s)
        self._factors = np.array([[mapping.ratio], [1.0 / mapping.ratio]])
        self.seen = False
        self._rows: dict[Side, deque[tuple[int, Array]]] = {
            "field": deque(maxlen=MOST_SAMPLES),
            "model": deque(maxlen=MOST_SAMPLES),
        }

    def add(self, side: Side, stamp_ns: int, state: DriveState) -> DriveWindow | None:
        """Add a message; the window that is complete with it, if one is. A stamp that steps back begins anew."""
        rows = self._rows[side]
        if rows and stamp_ns == rows[-1][0]:
            return None
        if rows and stamp_ns < rows[-1][0]:
            for one in self._rows.values():
                one.clear()
        if side == "model" and not self._rows["field"]:
            rows.clear()  # nothing will ask for what was before the first of the field
        self.seen |= side == "field"
        values = np.array([state.torque, state.speed])
        rows.append((stamp_ns, values * self._factors if side == "field" else values))
        return self._complete()

    def _complete(self) -> DriveWindow | None:
        field, model = self._rows["field"], self._rows["model"]
        if len(field) < LEAST_SAMPLES or not model:
            return None
        begin, end = field[0][0], field[-1][0]
        if end - begin < self._settings.window_s * NANOSECONDS or model[-1][0] < end:
            return None
        recorded, computed = ([row for row in rows if begin <= row[0] <= end] for rows in (field, model))
        field.clear()
        try:
            return DriveWindow(begin, end, self._compared(recorded, computed, end - begin))
        except InputError as error:
            return DriveWindow(begin, end, None, str(error))

    def _compared(self, recorded: Rows, computed: Rows, length_ns: int) -> DrivesResult:
        if len(computed) < _LEAST_OF_MODEL:
            raise InputError("no signal of the model in the window")
        record, history = drive_record(recorded), machine_history(self._machine, 0, length_ns)
        found = field_drives(record, self._machine, history, self._mapping.low_pass_hz, self._settings)
        model = _computed(drive_record(computed), found)
        return compare_drives(record, found, {0: model}, self._machine, self._mapping)


def _computed(record: DriveRecord, field: FieldDrives) -> DriveMoments:
    """Moments of the model's stream, through the filters of the field's where its rate allows."""
    columns = np.array(field.numbers) - 1
    if record.torque.shape[1] <= columns.max():
        raise InputError(f"the model has {record.torque.shape[1]} drives, allowed: {columns.max() + 1} or more")
    band = replace(field.band, rate_hz=sampling_rate(record.time))
    values = np.hstack([record.torque[:, columns], record.speed[:, columns]])
    if field.band.rate_hz < band.rate_hz:
        values = CausalFilter(recorder_filter(field.band, band.rate_hz)).process(values)
        values = band.low_passed(values)
    return drive_moments(np.zeros(len(values), np.int64), values, band)
