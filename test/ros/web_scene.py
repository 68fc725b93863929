"""What the nodes of a machine say in a given state, published by a peer: for the page, and for its pictures."""

import time
from contextlib import nullcontext
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3Stamped
from sensor_msgs.msg import JointState, PointCloud2

from tbm_dynamics import load_machine
from tbm_gsa.app.nodes.event_messages import event_status
from tbm_gsa.history import Context, Event, History, HistoryEntry, WindowSource
from tbm_gsa.history.event_list import ListedEvent
from tbm_gsa.provenance import machine_sha256
from tbm_msgs_py import ACCELERATION, OperatingPoint, topics
from tbm_msgs_py.base.drive_state import DriveState
from tbm_msgs_py.blocks import mesh_forces
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.registry import MACHINE_NODES

SECOND = 10**9
POINTS = topics.TEST_POINTS
LEVELS = dict(zip(POINTS, (1.9, 1.1, 0.7, 0.45, 0.3), strict=True))  # m/s²
RATE = 1000.0
ROCK = Event(0, "rock", "", "info", "rock", "rock changed: axial_low 1.62 (1.48 to 1.79)")
MACHINE = Event(
    0,
    "machine",
    "",
    "warning",
    "machine",
    "machine: x17 is 0.71 (0.66 to 0.78) of what it was, probability 0.96; look at the contact of girder and rock",
)
DEAD = Event(0, "dead", "walkway", "error", "sensor", "field measures next to nothing along x: a dead channel?")


class Scene:
    """Publishes what a machine's nodes say.

    Parameters
    ----------
    peer : Peer
    history : Path
        Gets the events, so that they can be acknowledged.
    """

    def __init__(self, peer, history):
        self.machine, self._peer, self._history = load_machine("dz101"), peer, Path(history)
        self._source = WindowSource("live", "/tbm/analysis_node", "", "dz101", machine_sha256(self.machine))
        self._made, self._random = {}, np.random.default_rng(0)
        self.lock = nullcontext()  # of a node in this process that reads the history

    def send(self, kind, topic, profile, *sent):
        """Publish messages on a topic."""
        if topic not in self._made:
            self._made[topic] = self._peer.publisher(kind, f"/tbm/{topic}" if topic[0] != "/" else topic, profile)
        for message in sent:
            self._made[topic].publish(message)
        self._peer.settle()

    def statuses(self, topic, *statuses):
        profile = qos.DIAGNOSTICS if topic == topics.DIAGNOSTICS else qos.GSA
        self.send(DiagnosticArray, topic, profile, messages.diagnostics(time.time_ns(), statuses))

    def nodes(self, *missing):
        """All nodes of the machine say that they work, but for those."""
        there = [name for name in MACHINE_NODES if name not in missing]
        said = [messages.status(f"tbm: {name}", "ok", "active", {"state": "active"}) for name in there]
        self.statuses(topics.DIAGNOSTICS, *said)

    def watch(self, text="as at the commissioning", rock="as at the commissioning", alarm=0, commissioned=True):
        """What the watch says."""
        values = {"alarm": alarm, "commissioned": commissioned}
        self.statuses(topics.MACHINE, messages.status("tbm: machine", "warn" if alarm else "ok", text, values))
        self.statuses(topics.ROCK, messages.status("tbm: rock", "ok", rock, {}))

    def drive(self, speed=None):
        """Operating point and context."""
        own = self.machine.operating_point
        point = own if speed is None else OperatingPoint(speed, own.torque, own.thrust)
        now = time.time_ns()
        self.send(JointState, topics.OPERATING_POINT, qos.OPERATING_POINT, messages.operating_point_message(now, point))
        said = {"ring": 412, "chainage": "1234.5", "rock_class": "III"}
        self.statuses(topics.CONTEXT, messages.status("site", "ok", "", said))

    def drives(self, uneven=0.02):
        """Torque of the ten drives, computed and measured, and their mesh forces."""
        for topic, scatter in ((topics.MODEL_DRIVES, uneven), (topics.FIELD_DRIVES, 3 * uneven)):
            torque = 2.0e5 * (1.0 + scatter * self._random.standard_normal(10))
            state = DriveState(tuple(torque), (9.0,) * 10)
            self.send(JointState, topic, qos.LIVE, messages.drives_message(time.time_ns(), state))
        forces = 4.0e5 * (1.0 + 0.1 * self._random.standard_normal((50, 10)))
        block = messages.block(mesh_forces(10), time.time_ns(), np.arange(50) / 5000.0, forces)
        self.send(PointCloud2, topics.MODEL_MESH_FORCES, qos.BLOCK, block)

    def windows(self, count=3, factors=None, silent=()):
        """Levels of the latest windows; factors on the measured ones by point."""
        begin = time.time_ns() // (2 * SECOND) * 2 * SECOND - 2 * count * SECOND
        for number in range(count):
            for point in POINTS:
                stamp, computed = begin + 2 * number * SECOND, LEVELS[point]
                measured = np.nan if point in silent else computed * 1.1 * (factors or {}).get(point, 1.0)
                for quantity, level in (("model_rms", computed), ("field_rms", measured)):
                    message = messages.vector3(stamp, (level,) * 3, point)
                    self.send(Vector3Stamped, topics.analysis(point, quantity), qos.ANALYSIS, message)

    def events(self, *events, age_s=900):
        """Events that stand, and one that has ended, in the history and on the topic."""
        now = time.time_ns()
        ended = Event(now - 7200 * SECOND, "lost", "girder", "warning", "sensor", "field covers 63 % of the window")
        changes = [{"end_ns": now - 7100 * SECOND, "snapshot": "snapshots/lost_girder"}]
        changes += [{"begin_ns": now - age_s * SECOND, "context": Context(412, 1234.5, "III")} for _ in events]
        with self.lock, History(self._history) as history:
            for event in history.events():
                history._connection.execute("DELETE FROM events WHERE number = ?", (event.number,))
            stored = [
                history.store_event(self._source, replaced(event, change))
                for event, change in zip((ended, *events), changes, strict=True)
            ]
        self.statuses(topics.EVENTS, *(event_status("tbm: event", ListedEvent.of(one)) for one in stored))

    def fill_history(self, hours=1.0, every_s=2.0, change=1.0, since_h=0.25):
        """Windows of some hours; the measured level of the girder changes by a factor at the end."""
        now, length = time.time_ns(), 2 * SECOND
        starts = np.arange(now - round(hours * 3600 * SECOND), now, round(every_s * SECOND)) // length * length
        level = 1.0 + 0.05 * np.sin(starts * 1e-9 / 7000.0)
        with History(self._history) as history:
            for point in POINTS:
                ratio = 1.1 * level * np.exp(0.06 * self._random.standard_normal(len(starts)))
                ratio = np.where((point == "girder") & (starts > now - since_h * 3600 * SECOND), change * ratio, ratio)
                entries = (
                    HistoryEntry(point, "x", int(start), length, LEVELS[point] * one, LEVELS[point], 0.1, 1.0)
                    for start, one in zip(starts, ratio, strict=True)
                )
                history.add(self._source, entries)

    def samples(self, rows, silent=(), change=1.0, end_ns=None):
        """Signals of all points, in so many rows of the waterfall."""
        span = 4 * SECOND
        begin = (end_ns or time.time_ns()) // span * span - rows * span
        offsets = np.arange(round(4.0 * RATE)) / RATE
        for row in range(rows):
            for point in POINTS:
                for side in ("model", "field"):
                    if side == "field" and point in silent:
                        continue
                    stamp = begin + row * span
                    factor = change if side == "field" and row > 0.7 * rows else 1.0
                    values = self._signal(stamp * 1e-9 % 1e4 + offsets, LEVELS[point], side, factor)
                    block = messages.block(ACCELERATION, stamp, offsets, values)
                    self.send(PointCloud2, f"{side}/{point}/block", qos.BLOCK, block)

    def _signal(self, t, level, side, factor):
        mesh, random = self.machine.mesh_frequency, self._random
        lines = [(mesh, 0.5 * factor), (2 * mesh, 0.3), (3 * mesh, 0.15), (130.3, 0.3), (106.2, 0.25), (76.25, 0.12)]
        x = sum(level * size * np.sin(2 * np.pi * frequency * t) for frequency, size in lines)
        noise = np.convolve(random.standard_normal(len(t) + 8), np.ones(9) / 9.0, "valid") * level
        x = x * (1.1 if side == "field" else 1.0) + noise * (1.3 if side == "field" else 0.9)
        return np.column_stack([x, 0.5 * x, 0.5 * x])


def replaced(event, change):
    """Event with other values."""
    return Event(**{name: getattr(event, name) for name in Event.__slots__} | change)


def healthy(scene, **samples):
    """All is well."""
    scene.nodes()
    scene.watch()
    scene.drive()
    scene.drives()
    scene.events()
    scene.windows()
