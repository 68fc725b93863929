"""TDMS files of LabVIEW: channels ``group/channel``, each with its own time base, read a piece at a time."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.texts import quoted
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.importing.layout import FileLayout, TimeBase, TimeColumn
from tbm_msgs_py.importing.measurement_file import MeasurementFile, Rows, library
from tbm_msgs_py.importing.moments import moment_ns
from tbm_msgs_py.importing.tdms_runs import Properties, Statement, read_statements

_EPOCH: Final = 2_082_844_800  # of 1970, seconds since 1904
_MOST_SCALES: Final = 1000  # nptdms makes as many objects as a file states
_SCALE_TYPE: Final = re.compile(r"NI_Scale\[\d+\]_Scale_Type")
# Those that nptdms applies; of any other it would give the raw counts. The last is a name for the result of others.
_APPLIED: Final = (
    *("Linear", "Polynomial", "Table", "Add", "Subtract", "Thermocouple", "Thermistor", "RTD", "Strain"),
    "AdvancedAPI",
)


_TIMES: Final = ("wf_start_time", "wf_start_offset", "wf_increment")
_UNIT: Final = ("NI_Scal", "unit_string")  # beginnings of the keys that say what a value means


@dataclass(frozen=True)
class _Run:
    """Samples that were taken without a break: number of the first, its time after the earliest start, and step, s."""

    first: int
    begin: float
    increment: float


class TdmsFile(MeasurementFile):
    """A TDMS file; the channels of one test point share their length and their times."""

    kind = "a TDMS"
    shared_rows = False
    clocks = ("file", "column")

    def __init__(self, path: Path, layout: FileLayout) -> None:
        super().__init__(path, layout)
        nptdms: Any = library("nptdms")
        # Its warnings go into the result; it would print them too.
        library("nptdms.log").log_manager.console_handler.setLevel(logging.CRITICAL)
        with self.reading():
            # Opened here: by its name it would believe an index file beside it, which may be an older one's.
            self._file = nptdms.TdmsFile.open(path.open("rb"))
            self._statements = read_statements(path)
        self._channels: dict[str, list[Any]] = {}
        for group in self._file.groups():
            for channel in group.channels():
                for name in (f"{group.name}/{channel.name}", channel.path):
                    self._channels.setdefault(name, []).append(channel)

    @property
    def start_ns(self) -> int | None:
        """Earliest start that a waveform states."""
        starts = [
            self._start(statement.properties)
            for channels in self._channels.values()
            for channel in channels
            for statement in self._statements.get(channel.path, [])
        ]
        return min((start for start in starts if start is not None), default=None)

    def unit(self, column: str) -> str:
        """Return the unit that the file states."""
        return str(self._channel(column).properties.get("unit_string", ""))

    def _pieces(self, columns: Sequence[str], time: TimeBase) -> Iterator[Rows]:
        clock = time if isinstance(time, TimeColumn) else None
        names = [*columns, *([clock.column] if clock else [])]
        channels = [self._channel(name) for name in names]
        for name, channel in zip(names, channels, strict=True):
            self._check_values(name, channel)
        if clock:
            return self.in_pieces(columns, channels, clock)
        if time is None:
            for name, channel in zip(columns, channels, strict=True):
                self._check_one_run(name, channel)
            return self.in_pieces(columns, channels)
        runs = [self._runs(name, channel) for name, channel in zip(columns, channels, strict=True)]
        for name, of_channel in zip(columns, runs, strict=True):
            if not all(run.increment > 0.0 for run in of_channel):
                raise self.error(
                    f"time: file: channel {name} has no wf_increment above 0, allowed: a time channel or a rate"
                )
        if any(of_channel != runs[0] for of_channel in runs):
            raise self.error(f"channels {', '.join(columns)} state different times, allowed: the same")
        return self.in_pieces(columns, channels, ticks=lambda rows: _times(runs[0], rows))

    def _check_one_run(self, name: str, channel: Any) -> None:
        """Refuse several runs, which a rate would put one behind the other, and name another rate of the file."""
        statements = self._times_of(channel)
        if len(statements) > 1:
            raise self.error(
                f"channel {name} has {len(statements)} runs with a start of their own, "
                "allowed: `time: file`, which keeps what is between them"
            )
        for statement in statements:
            if (increment := self._number(name, statement.properties, "wf_increment")) > 0.0:
                self.compare_rate(1.0 / increment, name)

    def _check_values(self, name: str, channel: Any) -> None:
        """Refuse values that are not in one unit: of a scale that is not applied, or of one that changes on the way."""
        holders = {
            channel.path: channel,
            self._file[channel.group_name].path: self._file[channel.group_name],
            "/": self._file,
        }
        for holder in holders.values():
            types = [value for key, value in holder.properties.items() if _SCALE_TYPE.fullmatch(key)]
            unknown = [value for value in types if value not in _APPLIED]
            count = holder.properties.get("NI_Number_Of_Scales", 0)
            if isinstance(count, str) or not 0 <= count <= _MOST_SCALES:
                raise self.error(f"channel {name}: {quoted(count)} scales, allowed: 0 to {_MOST_SCALES}")
            if unknown and holder.properties.get("NI_Scaling_Status") != "scaled":
                raise self.error(
                    f"channel {name}: its scale is {quoted(unknown[0])}, which nptdms cannot apply, "
                    f"allowed: {', '.join(_APPLIED)}, or values that are scaled"
                )
        stated = [holder.properties for holder in holders.values()]
        if channel.properties.get("NI_Scaling_Status") == "unscaled" and not any(map(_has_scale, stated)):
            raise self.error(
                f"channel {name}: unscaled, and no scale is stated, allowed: one that makes counts a value"
            )
        if channel.scaler_data_types and _counts_only(stated):
            raise self.error(
                f"channel {name}: counts of a converter (DAQmx) without a scale, allowed: one that makes counts a value"
            )
        try:
            channel[0:1]
        except Exception as error:
            why = " ".join(str(error).split()) or type(error).__name__
            raise self.error(
                f"channel {name}: its values cannot be read or scaled ({why}), allowed: whole ones"
            ) from error
        for before, after in (pair for path in holders for pair in pairwise(self._statements.get(path, []))):
            keys = sorted(key for key in before.properties.keys() | after.properties.keys() if key.startswith(_UNIT))
            for key in keys:
                old, new = before.properties.get(key), after.properties.get(key)
                if old != new and after.first:
                    raise self.error(
                        f"channel {name}: {key} changes from {quoted(old)} to {quoted(new)} at sample "
                        f"{after.first + 1}, allowed: one for all samples"
                    )

    def _times_of(self, channel: Any) -> list[Statement]:
        """Statements that change when the samples of a channel were taken."""
        found: list[Statement] = []
        last: list[str] = []
        for statement in self._statements.get(channel.path, []):
            stated = [repr(statement.properties.get(key)) for key in _TIMES]
            if stated not in (last, ["None"] * len(_TIMES)):
                found.append(statement)
                last = stated
        return found

    def _runs(self, name: str, channel: Any) -> list[_Run]:
        """List the runs of a channel: a new one where its start, offset or increment is stated anew."""
        runs: list[_Run] = []
        earliest = self.start_ns
        for statement in self._times_of(channel):
            if runs and statement.first == len(channel):
                raise self.error(
                    f"channel {name}: a start is stated behind its last sample, allowed: before its samples"
                )
            begin, increment = (self._number(name, statement.properties, key) for key in _TIMES[1:])
            own = self._start(statement.properties)
            if own is not None and earliest is not None:
                begin += (own - earliest) / NANOSECONDS
            if runs and not statement.first:  # stated anew before the first sample
                runs.pop()
            runs.append(_Run(statement.first if runs else 0, begin, increment))
        return runs or [_Run(0, 0.0, 0.0)]

    def _number(self, name: str, properties: Properties, key: str) -> float:
        value = properties.get(key, 0.0)
        if isinstance(value, str | bool) or not np.isreal(value) or not np.isfinite(value):
            raise self.error(f"channel {name}: {key} is {quoted(value)}, allowed: a number of seconds")
        return float(value)

    def _start(self, properties: Properties) -> int | None:
        """Start that a waveform states, ns since the epoch: TDMS times are of UTC, texts of the zone that is stated."""
        start = properties.get("wf_start_time")
        if start is None:
            return None
        if not hasattr(start, "second_fractions"):
            try:
                return moment_ns(str(start), self.zone)
            except ValueError as error:
                raise self.error(f"wf_start_time: {quoted(start)}: {error}") from None
        # Seconds since 1904, and parts of 2**64 of one.
        return (int(start.seconds) - _EPOCH) * NANOSECONDS + round(int(start.second_fractions) * NANOSECONDS / 2**64)

    def _channel(self, column: str) -> Any:
        found = self._channels.get(column, [])
        if not found:
            raise self.no_column(column, sorted(name for name in self._channels if not name.startswith("/'")))
        if len(found) > 1:
            paths = " or ".join(channel.path for channel in found)
            raise self.error(f"channel {column} is there {len(found)} times, allowed: {paths}")
        return found[0]


def _has_scale(properties: Properties) -> bool:
    return bool(properties.get("NI_Number_Of_Scales", 0)) or any(map(_SCALE_TYPE.fullmatch, properties))


def _counts_only(stated: Sequence[Properties]) -> bool:
    """Whether the scale that holds, the last one, is what the converter counted; that of DAQmx has no type."""
    holding: Properties = next((properties for properties in stated if properties.get("NI_Number_Of_Scales")), {})
    place = holding.get("NI_Number_Of_Scales", 0) - 1
    for _ in range(_MOST_SCALES):
        kind = holding.get(f"NI_Scale[{place}]_Scale_Type")
        if kind != "AdvancedAPI":  # a name for the result of another
            return kind is None
        place = holding.get(f"NI_Scale[{place}]_AdvancedAPI_Input_Source", -1)
    return True


def _times(runs: Sequence[_Run], rows: Integers) -> Array:
    """Find the times, ns after the earliest start, of samples by their numbers."""
    run = np.searchsorted([run.first for run in runs], rows, side="right") - 1
    first = np.array([run.first for run in runs])[run]
    begin = np.array([run.begin for run in runs])[run]
    increment = np.array([run.increment for run in runs])[run]
    return np.asarray((begin + increment * (rows - first)) * NANOSECONDS)
