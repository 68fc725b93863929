"""Publishers of every type and quality of service come, send anything and go: no node ends, and all is sound again."""

import random
import time

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from geometry_msgs.msg import AccelStamped, Vector3Stamped  # noqa: E402
from nav_msgs.msg import Goals  # noqa: E402
from peer import Rig  # noqa: E402
from rclpy.duration import Duration  # noqa: E402
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from sensor_msgs.msg import Imu, JointState, PointCloud2  # noqa: E402
from std_msgs.msg import String  # noqa: E402

from tbm_msgs_py import ACCELERATION, LOADS  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402

pytestmark = pytest.mark.ros

ERROR = 2
ACCEL = "/tbm/field/girder/accel"
FIELD = [ACCEL, "/tbm/field/girder/block"]
TOPICS = [
    *FIELD,
    "/tbm/field/shield/block",
    "/tbm/model/girder/block",
    "/tbm/loads/block",
    "/tbm/loads/operating_point",
    "/tbm/operating_point",
    "/tbm/analysis/gsa_status",
    "/tbm/news",
    "/diagnostics",
]
MEASURED = [AccelStamped, Imu, PointCloud2, Vector3Stamped]
KINDS = [*MEASURED, DiagnosticArray, Goals, JointState, String]
MOST = 8  # publishers at a time
STATUSES = {
    "analysis_node": [f"comparison {point}" for point in ("girder", "shield", "cutterhead")],
    "bag_recorder": ["recorder"],
    "live_view": ["live view"],
    "load_node": ["loads"],
    "dynamics_node": ["dynamics"],
}


class Graph:
    """Publishers that a seed chooses."""

    def __init__(self, seed):
        self._random = random.Random(seed)
        self.rigs = []
        self._made = 0

    def step(self):
        """Let one come, one go, or one send something."""
        chance = self._random.random()
        if not self.rigs or (chance < 0.35 and len(self.rigs) < MOST):
            self._made += 1
            topics, kinds = (FIELD, MEASURED) if self._random.random() < 0.5 else (TOPICS, KINDS)
            kind, topic = self._random.choice(kinds), self._random.choice(topics)
            self.rigs.append((Rig(kind, topic, self._profile(), f"rig_{self._made}"), kind))
        elif chance < 0.55:
            self.rigs.pop(self._random.randrange(len(self.rigs)))[0].close()
        else:
            rig, kind = self._random.choice(self.rigs)
            rig.publish(self._message(kind))

    def _profile(self):
        choose = self._random.choice
        return QoSProfile(
            history=choose([HistoryPolicy.KEEP_LAST, HistoryPolicy.KEEP_ALL]),
            depth=choose([1, 5, 100]),
            reliability=choose([ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT]),
            durability=choose([DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL]),
            deadline=choose([Duration(), Duration(seconds=0.1)]),
            lifespan=choose([Duration(), Duration(seconds=0.1)]),
        )

    def _message(self, kind):
        """Empty, of random bytes, or a block of random samples and times."""
        form = self._random.choice(["empty", "bytes", "block"])
        if form == "bytes":
            return bytes(4) + self._random.randbytes(self._random.randrange(200))
        if form == "empty" or kind is not PointCloud2:
            return kind()
        numbers = np.random.default_rng(self._random.getrandbits(32))
        layout, count = self._random.choice([ACCELERATION, LOADS]), self._random.choice([1, 2, 50])
        times = numbers.choice([0.0, 1e-12, 1e-3, 1.0, -1.0, 1e5, np.nan, np.inf], count)
        values = numbers.choice([0.0, 1.0, -1e7, 1e300, np.nan, -np.inf], (count, len(layout.channels)))
        stamp = self._random.choice([-(10**18), 0, time.time_ns(), 2 * 10**18])
        with np.errstate(over="ignore"):
            return messages.block(layout, stamp, times, values, self._random.choice(["", "girder", "shield"]))

    def close(self):
        for rig, _ in self.rigs:
            rig.close()
        self.rigs = []


class Nodes:
    """Nodes as processes, by name."""

    def __init__(self, run_node, peer, folder, names):
        self._peer, self._names = peer, names
        parameters = {
            "analysis_node": {"history": "none", "gsa.on_threshold": False},
            "bag_recorder": {"output": folder / "bag", "topics": f"[{','.join(TOPICS)}]"},
            "live_view": {"port": 0, "blocks": True},
        }
        self._processes = {name: run_node(name, **parameters.get(name, {})) for name in names}
        self.wait_until(self._active)

    def wait_until(self, condition):
        def step():
            self._peer.spin()
            for name, node in self._processes.items():
                assert node.process.poll() is None, f"{name} ended:\n{node.output}"

        self._peer.wait_for(condition, step=step)

    def _own(self):
        return [self._peer.diagnostics.get(f"tbm: {name}") for name in self._names]

    def _active(self):
        return all(status and (status.level, status.message) == (0, "active") for status in self._own())

    def breathe(self):
        """Wait until every node has said how it is."""
        before = [status.came for status in self._own()]
        self.wait_until(lambda: all(status.came > came for status, came in zip(self._own(), before, strict=True)))

    def are_sound(self):
        """Wait until no status is an error and no callback was ever surprised; each answers."""
        names = [f"tbm: {task}" for name in self._names for task in STATUSES[name]]
        diagnostics = self._peer.diagnostics
        self.breathe()
        self.wait_until(lambda: all(name in diagnostics and diagnostics[name].level != ERROR for name in names))
        self.wait_until(self._active)
        for name, status in zip(self._names, self._own(), strict=True):
            assert status.values["failed_callbacks"] == "0", self._processes[name].output
            assert self._peer.state(f"/tbm/{name}") == "active"


def hold_against(graph, nodes, peer, until):
    """Let the graph change until a condition holds; the nodes are sound afterwards, and take what is right."""
    try:
        while not until():
            graph.step()
            peer.spin()
            if graph._random.random() < 0.3:
                nodes.breathe()
    finally:
        graph.close()
    nodes.are_sound()
    with Rig(AccelStamped, ACCEL, qos.LIVE) as rig:

        def taken():
            rig.publish(messages.accel(time.time_ns(), (0.0, 0.0, 9.81), "girder"))
            return float(peer.value("tbm: comparison girder", "field_rate_hz") or 0.0) > 0.0

        nodes.wait_until(taken)


@pytest.mark.parametrize("seed", [1])
def test_no_event_of_others_ends_a_node(run_node, peer, tmp_path, seed):
    pytest.importorskip("foxglove")
    nodes = Nodes(run_node, peer, tmp_path, ["analysis_node", "bag_recorder", "live_view"])
    left = iter(range(40))
    hold_against(Graph(seed), nodes, peer, until=lambda: next(left, None) is None)


@pytest.mark.verify  # minutes
@pytest.mark.parametrize("seed", [2, 3])
def test_a_minute_of_events_of_others_ends_no_node(run_node, peer, tmp_path, seed):
    pytest.importorskip("foxglove")
    nodes = Nodes(run_node, peer, tmp_path, list(STATUSES))
    end = time.monotonic() + 60.0
    hold_against(Graph(seed), nodes, peer, until=lambda: time.monotonic() > end)
