"""Nodes killed and started again, as processes: the others show it, go on, and are sound again."""

import signal

import pytest

rclpy = pytest.importorskip("rclpy")

from peer import alive, children  # noqa: E402
from processes import wait_for  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from tbm_msgs_py import ACCELERATION  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402
from tbm_msgs_py.topics import TEST_POINTS  # noqa: E402

pytestmark = pytest.mark.ros

DYNAMICS, LOADS = "tbm: dynamics", "tbm: loads"
COMPARISONS = [f"tbm: comparison {point}" for point in TEST_POINTS]
OK, ERROR, STALE = 0, 2, 3


class System:
    """Loads, dynamics and analysis, and sensors that measure what the model says, 10 % less."""

    def __init__(self, peer, run_node, studies):
        self.peer, self._run = peer, run_node
        self._parameters = {
            "analysis_node": {"gsa.on_threshold": False, "gsa.samples": 2000, "gsa.folder": studies},
            "dynamics_node": {},
            "load_node": {"wait_for_subscribers": 1},
        }
        for point in TEST_POINTS:
            self._measure(point)
        self.nodes = {}
        for name in self._parameters:
            self.start(name)

    def _measure(self, point):
        field = self.peer.node.create_publisher(PointCloud2, f"/tbm/field/{point}/block", qos.BLOCK)

        def measure(message):
            block = messages.block_from(message)
            field.publish(messages.block(ACCELERATION, block.stamp_ns, block.offsets, 0.9 * block.values, point))

        self.peer.node.create_subscription(PointCloud2, f"/tbm/model/{point}/block", measure, qos.BLOCK)

    def start(self, name):
        self.nodes[name] = self._run(name, **self._parameters[name])

    def kill(self, name):
        self.nodes[name].send(signal.SIGKILL)
        assert self.nodes[name].exit_code() == -signal.SIGKILL

    def wait_until(self, level, text, names):
        """Wait until `/diagnostics` shows this level and text for all of the names."""
        shown = self.peer.diagnostics
        self.peer.wait_for(
            lambda: all(name in shown and shown[name].level == level and text in shown[name].message for name in names)
        )


@pytest.mark.verify
def test_nodes_killed_and_started_again(run_node, peer, tmp_path):
    system = System(peer, run_node, tmp_path)
    everything = [DYNAMICS, LOADS, *COMPARISONS]
    system.wait_until(OK, "", everything)
    system.kill("dynamics_node")
    system.wait_until(STALE, "no signal of the", COMPARISONS)
    peer.diagnostics.pop(DYNAMICS)  # what is dead says nothing more
    system.start("dynamics_node")
    system.wait_until(OK, "", everything)

    assert peer.call(Trigger, "/tbm/analysis/run_gsa").success
    analysis = system.nodes["analysis_node"].process.pid
    peer.wait_for(lambda: len(children(analysis)) >= 3)  # the study and its workers
    study = children(analysis)
    system.kill("analysis_node")
    system.kill("load_node")
    wait_for(lambda: not any(map(alive, study)))
    system.wait_until(ERROR, "no block on loads/block for", [DYNAMICS])
    for name in (LOADS, *COMPARISONS):
        peer.diagnostics.pop(name)
    system.start("analysis_node")
    system.start("load_node")
    system.wait_until(OK, "", everything)
    assert int(peer.value(DYNAMICS, "restarts")) >= 1  # more where a busy computer lets the new loads start twice
