"""Recordings of the moment of an event: the raw messages of the time before it, and of some time after."""

from __future__ import annotations

import queue
import threading
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from tbm_gsa.app.nodes.block_ring import BlockRing, KeptMessage
from tbm_gsa.history import Event
from tbm_msgs_py.bags.quota import enforce, mark
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.units import NANOSECONDS

REPEAT_NS: Final = 600 * NANOSECONDS
"""Within which an event of the same kind, test point and level gets no further recording: it would drive others out."""
_PAUSE_S: Final = 0.1  # between two looks at a ring that had nothing new
_YIELD_S: Final = 0.002  # between two looks at one that had: the node goes first
_PATIENCE_S: Final = 1.5  # at the end of the node


@dataclass(frozen=True)
class SnapshotOutcome:
    """What came of a recording: why it ended early, and whether anything of it can be read."""

    path: str
    problem: str
    there: bool


class Snapshot:
    """One recording, written in a thread of its own that follows the ring.

    Parameters
    ----------
    path : Path
        New folder.
    ring : BlockRing
    quota : float
        Bytes that the folder's recordings may take.
    """

    def __init__(self, path: Path, ring: BlockRing, quota: float) -> None:
        self.path, self._ring, self._quota = path, ring, quota
        self.over, self.outcome = threading.Event(), queue.SimpleQueue[SnapshotOutcome]()
        self._thread = threading.Thread(target=self._work, name="snapshot", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it with what has come."""
        self.over.set()
        self._thread.join(_PATIENCE_S)

    def _work(self) -> None:
        writer, problem = BagWriter(self.path, custom_data=mark(self._quota / 1e6)), ""
        try:
            writer.open()
            problem = self._follow(writer)
            enforce(self._quota, writer)
            writer.close()
        except (RecordingError, OSError) as error:
            problem = str(error)
            writer.salvage()
        self.outcome.put(SnapshotOutcome(str(self.path), problem, self.path.exists()))

    def _follow(self, writer: BagWriter) -> str:
        """Write what the ring holds and what comes until it is over; what of it was gone before."""
        latched, (number, found) = self._ring.latched(), self._ring.after(0)
        for message in latched:
            _write(writer, message, found[0].at_ns if found else message.at_ns)
        lost = 0
        while True:
            for message in found:
                _write(writer, message, message.at_ns)
            writer.flush()
            last, before = self.over.is_set(), number
            number, found = self._ring.after(before)
            lost += number - before - len(found)
            if last and not found:
                return f"{lost} messages were gone before they were written" if lost else ""
            self.over.wait(_YIELD_S if found else _PAUSE_S)


def _write(writer: BagWriter, message: KeptMessage, at_ns: int) -> None:
    writer.write(message.topic, message.type, at_ns, message.data, qos=message.quality)


class Snapshots:
    """Makes a recording of an event, one at a time.

    Parameters
    ----------
    folder : Path or None
        Where they go; None for none.
    before, after : float
        s.
    memory, quota : float
        Bytes.
    """

    def __init__(self, folder: Path | None, before: float, after: float, memory: float, quota: float) -> None:
        self._folder, self._after_ns, self._quota = folder, round(after * NANOSECONDS), quota
        self._ring = BlockRing(round(memory), round(before * NANOSECONDS))
        self._running: Snapshot | None = None
        self._span = (0, 0)
        self._last: dict[tuple[str, str, str], int] = {}

    @property
    def wanted(self) -> bool:
        """Whether recordings are made."""
        return self._folder is not None

    def keep(self, message: KeptMessage) -> None:
        """Keep a message for what may come."""
        self._ring.add(message)

    def begin(self, event: Event, now_ns: int) -> str:
        """Begin the recording of an event; its path, that of one which runs, or empty where none is made."""
        if self._folder is None or not self._ring.count:
            return ""
        key = (event.kind, event.point, event.level)
        if self._running is not None:
            self._last[key] = now_ns
            return str(self._running.path)
        if abs(now_ns - self._last.get(key, now_ns - 2 * REPEAT_NS)) < REPEAT_NS:
            return ""
        self._last[key] = now_ns
        moment = datetime.fromtimestamp(now_ns // NANOSECONDS, UTC).strftime("%Y%m%dT%H%M%SZ")
        name = "_".join(filter(None, (moment, event.kind, event.point)))
        names = (name, *(f"{name}_{number}" for number in range(2, 1000)))
        path = next((path for path in map(self._folder.joinpath, names) if not path.exists()), None)
        if path is None:
            return ""
        self._ring.held = True
        self._running, self._span = Snapshot(path, self._ring, self._quota), (now_ns, now_ns + self._after_ns)
        return str(path)

    def poll(self, now_ns: int) -> SnapshotOutcome | None:
        """End the recording that runs when it is time; what came of one that has ended."""
        if self._running is None:
            return None
        begin_ns, end_ns = self._span
        if not begin_ns <= now_ns < end_ns:  # the clock may have jumped back
            self._running.over.set()
        with suppress(queue.Empty):
            outcome = self._running.outcome.get_nowait()
            self._running, self._ring.held = None, False
            return outcome
        return None

    def close(self) -> None:
        """End the recording that runs with what has come."""
        if self._running is not None:
            self._running.close()
