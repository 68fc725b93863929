"""Events of the analysis node: from its watch, its simple alarm and its signals, to the history and to the site."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from tbm_gsa.app.nodes.event_findings import SIGNAL_KINDS, SignalFindings, watch_findings
from tbm_gsa.app.nodes.event_keeper import EventKeeper, Finding, Key
from tbm_gsa.app.nodes.history_writer import HistoryWriter, kind_of, live_now
from tbm_gsa.app.nodes.live_watch import WatchUpdate
from tbm_gsa.app.nodes.settings import EventSettings
from tbm_gsa.app.nodes.site_hook import SiteHook
from tbm_gsa.app.nodes.statuses import event_status
from tbm_gsa.app.nodes.stream_health import Condition
from tbm_gsa.comparison import WindowResult
from tbm_gsa.history import UNKNOWN
from tbm_gsa.history.event_list import ListedEvent
from tbm_msgs_py.nodes.managed import ManagedNode

SPAN_NS = 60_000_000_000  # of the watch


class LiveEvents:
    """Finds, keeps, publishes and tells of events.

    Parameters
    ----------
    node : ManagedNode
    settings : EventSettings
    history : HistoryWriter
    publish : callable
        Called with the statuses of the newest events when they have changed.
    """

    def __init__(
        self,
        node: ManagedNode[Any],
        settings: EventSettings,
        history: HistoryWriter,
        publish: Callable[[list[DiagnosticStatus]], None],
    ) -> None:
        self._node, self._publish = node, publish
        self._hook = SiteHook(settings.command, settings.post)
        self._signals = SignalFindings()
        self._keeper = EventKeeper(history, lambda _: UNKNOWN, lambda _: "", self._hook.tell)
        self._published: tuple[ListedEvent, ...] | None = None

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
        newest = self._keeper.poll(self._node.get_clock().now().nanoseconds)
        for problem in self._hook.outcomes():
            self._node.faults.update("events", problem)
        if newest != self._published:
            self._published = newest
            self._publish([event_status(self._node.status_name("event"), one) for one in newest])

    def close(self) -> None:
        """End what is told; what stands goes on when the node does."""
        self._keeper.close(self._node.get_clock().now().nanoseconds)
        self._hook.close()


def _of_signal(point: str, key: Key) -> bool:
    return key[0] in SIGNAL_KINDS and key[1] == point
