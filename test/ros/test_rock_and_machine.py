"""`analysis_node` watches rock and machine: half an hour of blocks, a sensor whose gain changes, the topics, a restart.

The machine is one whose band powers add (`watched_spans`); what the training makes of a real one is tested elsewhere.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from sensor_msgs.msg import JointState, PointCloud2  # noqa: E402

from tbm_gsa.app.nodes import gsa_process, level_watch  # noqa: E402
from tbm_gsa.app.nodes.analysis_node import AnalysisNode  # noqa: E402
from tbm_gsa.explanation.live_observation import LiveObservation  # noqa: E402
from tbm_gsa.history import EventSelection, HistoryReader  # noqa: E402
from tbm_msgs_py import ACCELERATION, OperatingPoint  # noqa: E402
from tbm_msgs_py.base.units import iso_time  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402

sys.path.append(str(Path(__file__).parents[1] / "gsa"))
from watched_spans import MINUTE, START, curves  # noqa: E402

pytestmark = pytest.mark.ros

RATE, BLOCK_S, LEARNT = 50, 60, 30
POINTS = ("shield", "girder")
OFFSETS = np.arange(BLOCK_S * RATE) / RATE


class Boring:
    """Blocks of white noise of both points, a minute at a time."""

    def __init__(self, peer):
        self._peer, self._random, self._block = peer, np.random.default_rng(3), 0
        self._plc = peer.publisher(JointState, "/tbm/operating_point", qos.OPERATING_POINT)
        self._points = {point: peer.publisher(PointCloud2, f"/tbm/field/{point}/block", qos.BLOCK) for point in POINTS}
        self._drive()

    def _drive(self):
        self._plc.publish(messages.operating_point_message(START, OperatingPoint(0.7, 4e6, 9e6)))
        self._peer.settle()

    def wait_for_nodes(self, count):
        """Wait until so many nodes are there; a new one knows how the machine is driven before its first block."""
        made = (self._plc, *self._points.values())
        self._peer.wait_for(lambda: {one.get_subscription_count() for one in made} == {count})
        if count:
            self._drive()

    def __call__(self, minutes, shield=1.0, points=POINTS):
        for _ in range(minutes * 60 // BLOCK_S):
            for point, publisher in ((point, self._points[point]) for point in points):
                gain = shield if point == "shield" else 1.0
                values = gain * self._random.standard_normal((len(OFFSETS), 3))
                stamp = START + self._block * BLOCK_S * 10**9
                publisher.publish(messages.block(ACCELERATION, stamp, OFFSETS, values))
                self._peer.settle()
            self._block += 1


def lines(message):
    return {status.name: {pair.key: pair.value for pair in status.values} for status in message.status}


def processes(module, *_):
    """An explanation that is there at once, and a study that goes on."""
    return ["sh", "-c", "echo sensor: so it is >&2" if module.endswith("alarm_explanation") else "cat"]


def sensor_event(folder):
    """The one event of a sensor in the history of a folder."""
    with HistoryReader(folder / "h.sqlite") as history:
        (event,) = history.events(EventSelection(kind="sensor"))
    return event


def test_rock_machine_and_alarm_are_published(host_node, peer, tmp_path, monkeypatch):
    monkeypatch.setattr(level_watch, "kept_curves", lambda _, reading: curves(reading))
    monkeypatch.setattr(gsa_process, "child_command", processes)
    machine = peer.listen(DiagnosticArray, "/tbm/analysis/machine", qos.GSA)
    given = {"history": tmp_path / "h.sqlite", "window": 60.0, "watch.commissioning": 0.5, "gsa.folder": tmp_path}
    node = host_node(AnalysisNode, **given)
    node.wait_for(lambda: peer.text("tbm: machine") == "no minute of steady boring yet")
    boring = Boring(peer)
    boring(LEARNT + 2)  # the filters settle in the first
    node.wait_for(lambda: peer.text("tbm: machine") == "as at the commissioning")
    boring(4, shield=3.0)
    node.wait_for(lambda: "sensor: gain at shield x, y, z, factor" in peer.text("tbm: machine"))
    text = peer.text("tbm: machine")
    assert "look at the sensor, its mounting, cable and range; rock: " in text
    node.wait_for(lambda: node.says("explanation: sensor: so it is"))
    node.wait_for(lambda: peer.value("tbm: sensitivity analysis", "step") == "study")
    (observed,) = tmp_path.glob("gsa_*/observed.json")
    assert 60.0 <= LiveObservation.model_validate_json(observed.read_text()).seconds <= 240.0
    assert node.says(f"[WARNING] 6.68 r/min, 4e+03 kN·m, 9e+03 kN: {text.partition(', factor')[0]}")
    found = lines(machine[-1])
    assert (found["tbm: machine"]["name"], found["tbm: machine"]["alarm"]) == ("sensor", "1")
    assert float(found["tbm: machine"]["low"]) < float(found["tbm: machine"]["value"])
    rock = peer.listen(DiagnosticArray, "/tbm/analysis/rock", qos.GSA)  # latched: comes to the late
    peer.wait_for(lambda: rock)
    assert set(lines(rock[0])["tbm: rock lateral"]) == {"name", "value", "low", "high", "probability", "since"}
    assert "out of range Min: 0.5" in peer.set_parameters("/tbm/analysis_node", watch__commissioning=0.1)[0]
    node.close()
    boring.wait_for_nodes(0)

    peer.diagnostics.clear()
    again = host_node(AnalysisNode, **given)
    boring.wait_for_nodes(1)
    boring(3, shield=3.0)
    again.wait_for(lambda: "sensor: gain at shield" in peer.text("tbm: machine"))
    since = found["tbm: machine"]["since"]
    assert peer.value("tbm: machine", "since") == since
    assert abs(int(np.datetime64(since[:-1], "ns")) - START - (LEARNT + 2) * MINUTE) <= 2 * MINUTE
    assert not again.says("sensor: gain")  # it was raised before
    again.wait_for(lambda: sensor_event(tmp_path).event.end_ns is None)  # that of a replay has ended with the node
    event = sensor_event(tmp_path)
    assert (event.event.point, event.event.verdict) == ("shield", "sensor")
    assert (iso_time(event.event.begin_ns), event.source.kind) == (since, "replay")
    boring(5, shield=3.0, points=["shield"])
    again.wait_for(lambda: peer.text("tbm: rock").endswith("; not measured in the last minute: girder"))


def test_the_rule_of_the_alarm_and_the_baseline_are_chosen(host_node, peer):
    node = host_node(AnalysisNode, history="none", alarm="threshold")
    (refused,) = peer.set_parameters("/tbm/analysis_node", alarm="loud")
    assert "allowed: one of sequential, threshold" in refused
    assert not peer.set_parameters("/tbm/analysis_node", alarm="sequential", watch__baseline="repaired")
    node.wait_for(lambda: peer.value("tbm: machine", "alarm") == "0")
