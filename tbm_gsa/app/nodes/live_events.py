"""Events of the analysis node: from its watch, its simple alarm and its signals, to the history and to the site."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import serialize_message

from tbm_gsa.app.nodes.block_ring import KeptMessage
from tbm_gsa.app.nodes.event_findings import SIGNAL_KINDS, SignalFindings, watch_findings
from tbm_gsa.app.nodes.event_keeper import EventKeeper, Finding, Key
from tbm_gsa.app.nodes.event_messages import event_status
from tbm_gsa.app.nodes.history_writer import HistoryWriter, kind_of, live_now
from tbm_gsa.app.nodes.live_watch import WatchUpdate
from tbm_gsa.app.nodes.settings import AnalysisSettings
from tbm_gsa.app.nodes.site_hook import SiteHook
from tbm_gsa.app.nodes.snapshots import Snapshots
from tbm_gsa.app.nodes.stream_health import Condition
from tbm_gsa.comparison import WindowResult
from tbm_gsa.history import Context, Event
from tbm_gsa.history.context import ContextLog, read_context
from tbm_gsa.history.event_list import ListedEvent
from tbm_msgs_py import topics
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.nodes import messages
from tbm_msgs_py.nodes.managed import ManagedNode
from tbm_msgs_py.topics import TopicContract

SPAN_NS = 60_000_000_000  # of the watch


class LiveEvents:
    """Finds, keeps, publishes and tells of events.

    Parameters
    ----------
    node : ManagedNode
    history : HistoryWriter
    publish : callable
        Called with the statuses of the newest events when they have changed.
    """

    def __init__(
        self,
        node: ManagedNode[AnalysisSettings],
        history: HistoryWriter,
        publish: Callable[[list[DiagnosticStatus]], None],
    ) -> None:
        self._node, self._publish = node, publish
        told, recorded = node.settings.events, node.settings.snapshot
        self._hook = SiteHook(told.command, told.post)
        self._signals, self._context = SignalFindings(), ContextLog()
        folder = Path(recorded.folder) if recorded.folder else _beside(history.path)
        times, sizes = (recorded.before, recorded.after), (recorded.memory * 1e6, recorded.quota * 1e6)
        self._snapshots = Snapshots(folder if recorded.quota else None, *times, *sizes)
        self._keeper = EventKeeper(history, self._context.at, self._record, self._hook.tell)
        self._published: tuple[ListedEvent, ...] | None = None

    def keep(self, topic: str, offered: TopicContract, message: Any) -> None:
        """Keep a message for the recording of an event."""
        if self._snapshots.wanted:
            name, now_ns = topics.absolute(topic, self._node.get_namespace()), self._now_ns()
            self._snapshots.keep(KeptMessage(name, *offered, now_ns, serialize_message(message)))

    def on_context(self, message: DiagnosticArray) -> None:
        """Take what the site says of ring, chainage, rock class and shift."""
        try:
            stamp_ns = messages.stamp_to_ns(message.header.stamp)
            said = read_context((pair.key, pair.value) for status in message.status for pair in status.values)
            problem = self._context.add(stamp_ns, said, self._now_ns())
        except InputError as error:
            problem = f"{error}; the last one stays"
        else:
            self.keep(topics.CONTEXT, topics.contract(topics.CONTEXT), message)
        self._node.faults.update("context", f"{topics.CONTEXT}: {problem}" if problem else "")

    def context_at(self, time_ns: int) -> Context:
        """Context at a time."""
        return self._context.at(time_ns)

    def on_watch(self, update: WatchUpdate) -> None:
        """Take what the watch of a level says after a minute."""
        level, source = update.level.level, update.level.stored.source
        found = watch_findings(level, update.state)
        self._keeper.update(found, lambda key: key[2] == level, update.start_ns + SPAN_NS, source.kind)

    def on_level(self, result: WindowResult, reason: str) -> None:
        """Take why the simple alarm of a test point stands after a window; empty if it does not."""
        point, end_ns = result.point, result.start_ns + result.length_ns
        found = [Finding("level", point, "warning", "", reason, since_ns=None)] if reason else []
        kind = kind_of(end_ns, live_now(self._node.get_clock()))
        self._keeper.update(found, lambda key: key[:2] == ("level", point), end_ns, kind)

    def on_signals(self, latest: Mapping[str, WindowResult], conditions: Mapping[str, Condition]) -> None:
        """Take the latest windows and the conditions of the signals; of a point that has neither nothing is known."""
        clock = self._node.get_clock()
        now_ns, kind = clock.now().nanoseconds, kind_of(clock.now().nanoseconds, live_now(clock))
        for point in latest.keys() | conditions.keys():
            found = self._signals.at(point, latest.get(point), conditions.get(point, Condition()))
            self._keeper.update(found, partial(_of_signal, point), now_ns, kind)

    def poll(self) -> None:
        """Do what is due, and publish the newest events if they have changed."""
        newest = self._keeper.poll()
        if (outcome := self._snapshots.poll(self._now_ns())) is not None:
            self._node.faults.update("snapshot", f"{outcome.path}: {outcome.problem}" if outcome.problem else "")
            if not outcome.there:
                self._keeper.drop_snapshot(outcome.path)
        for problem in self._hook.outcomes():
            self._node.faults.update("events", problem)
        if newest != self._published:
            self._published = newest
            self._publish([event_status(self._node.status_name("event"), one) for one in newest])

    def close(self) -> None:
        """End what is told; what stands goes on when the node does."""
        self._snapshots.close()
        self._keeper.close(self._now_ns())
        self._hook.close()

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _record(self, event: Event) -> str:
        return self._snapshots.begin(event, self._now_ns())


def _beside(history: str) -> Path | None:
    """Folder of recordings beside a history."""
    return Path(history).absolute().with_name("snapshots") if history else None


def _of_signal(point: str, key: Key) -> bool:
    return key[0] in SIGNAL_KINDS and key[1] == point
