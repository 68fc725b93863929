"""Two machines side by side, each in its namespace, one with a remapped topic; parameters; quality of service."""

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from geometry_msgs.msg import AccelStamped  # noqa: E402
from peer import Peer, SimulatedClock, Status, stamps  # noqa: E402
from rclpy.qos import ReliabilityPolicy  # noqa: E402
from sensor_msgs.msg import JointState, PointCloud2  # noqa: E402

from tbm_dynamics import load_machine, simulate  # noqa: E402
from tbm_dynamics.nodes.dynamics_node import DynamicsNode  # noqa: E402
from tbm_dynamics.nodes.load_node import LoadNode  # noqa: E402
from tbm_gsa.app.nodes.analysis_node import AnalysisNode  # noqa: E402
from tbm_msgs_py.base.operating_point import from_joint_state  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402

pytestmark = pytest.mark.ros

SEEDS = {"north": 1, "south": 2}
LOADS = {"north": "loads/block", "south": "loads/excavation"}  # what the topic is called there
LAYOUTS = Path(__file__).parents[2] / "config" / "layouts"
STEP_NS = 200_000


@pytest.fixture(scope="module")
def machines():
    """A peer, the clock and the load blocks and mesh forces of both machines by namespace and topic."""
    with Peer() as peer:
        blocks = {}
        for name in SEEDS:
            for topic in (LOADS[name], "model/mesh_forces"):
                blocks[name, topic] = peer.listen(PointCloud2, f"/{name}/{topic}", qos.BLOCK)
        clock = SimulatedClock(peer, 1_700_000_000_000_000_000)
        hosted = []
        for name, seed in SEEDS.items():
            quality = {f"qos_overrides./{name}/model/shield/accel.publisher.reliability": "reliable"}
            quality |= {f"qos_overrides./{name}/model/mesh_forces.publisher.depth": 200}
            remapped = ("-r", f"__ns:=/{name}", "-r", f"loads/block:={LOADS[name]}")
            hosted.append(peer.host(DynamicsNode, *remapped, use_sim_time=True, seed=seed, **quality))
            hosted.append(peer.host(LoadNode, *remapped, use_sim_time=True, seed=seed))
        hosted.append(peer.host(AnalysisNode, "-r", "__ns:=/north", use_sim_time=True, history="none", window=0.5))
        yield Machines(peer, clock, hosted, blocks)


class Machines:
    def __init__(self, peer, clock, hosted, blocks):
        self.peer, self.clock, self.blocks = peer, clock, blocks
        self._hosted = hosted

    def run_until(self, condition):
        self.peer.wait_for(condition, step=self._step)

    def _step(self):
        self.clock.run_for(0.1)
        for hosted in self._hosted:
            hosted.report()


def test_two_machines_do_not_meet(machines):
    peer, blocks = machines.peer, machines.blocks
    machines.run_until(lambda: all(len(received) > 20 for received in blocks.values()))
    for name, seed in SEEDS.items():
        epoch, moved = stamps(blocks[name, LOADS[name]])[0], blocks[name, "model/mesh_forces"][:20]
        response = simulate(load_machine("dz101"), duration=(stamps(moved)[-1] - epoch) / 1e9 + 0.05, seed=seed)
        for message in moved:
            block = messages.block_from(message)
            first = (block.stamp_ns - epoch) // STEP_NS
            assert np.array_equal(block.values, response.mesh_force[::2][first : first + 250]), name
    wanted = {f"{name}: {task}" for name in SEEDS for task in ("dynamics", "loads")}
    machines.run_until(lambda: wanted | {"north: comparison shield"} <= set(peer.diagnostics))
    assert not [name for name in peer.diagnostics if name.startswith("tbm:")]


def test_a_remapped_topic_goes_by_its_new_name(machines):
    """That the south's dynamics follow its loads is seen above."""
    peer = machines.peer
    publishers = peer.node.get_publishers_info_by_topic("/south/loads/excavation")
    assert [(known.node_namespace, known.node_name) for known in publishers] == [("/south", "load_node")]
    assert peer.node.count_publishers("/south/loads/block") == 0
    assert peer.node.count_publishers("/north/loads/block") == 1


def test_parameters_at_run_time(machines):
    peer = machines.peer
    points = peer.listen(JointState, "/north/loads/operating_point", qos.OPERATING_POINT)
    accels = peer.listen(AccelStamped, "/north/model/shield/accel", qos.LIVE)
    machines.run_until(lambda: points and accels)
    assert not peer.set_parameters("/north/load_node", operating_point__torque=2000.0, operating_point__thrust=9000.0)
    machines.run_until(lambda: len(points) == 2)
    applied = from_joint_state(points[1])
    assert (applied.torque, applied.thrust) == (2.0e6, 9.0e6)
    assert applied.speed == load_machine("dz101").operating_point.speed
    assert not peer.set_parameters("/north/dynamics_node", live_rate=20.0)
    machines.run_until(lambda: np.diff(stamps(accels))[-3:].tolist() == [50_000_000] * 3)
    assert not peer.set_parameters("/north/analysis_node", gsa__outputs=["MF_M", "peak_shield_x"], gsa__duration=2.0)
    assert not peer.set_parameters("/north/analysis_node", threshold=0.5, window=1.0, alarm_axes=["x", "z"])

    for node, values, reason in (
        ("load_node", {"operating_point__speed": 1e6}, "speed"),
        ("dynamics_node", {"live_rate": 5000.0}, "live_rate"),
        ("dynamics_node", {"block_rate": 1000}, "fixed while the node is configured; clean up, set, configure"),
        ("dynamics_node", {"sensor__bias": [0.0, 0.0, 1e5]}, "allowed: 3 decimal numbers from -10000 to 10000"),
        ("dynamics_node", {"sensor__mounting_rotation": [400.0, 0.0, 0.0]}, "3 decimal numbers from -360 to 360"),
        ("dynamics_node", {"autostart": False}, "read-only"),
        ("analysis_node", {"alarm_axes": ["w"]}, "allowed: one or more of x, y, z"),
        ("analysis_node", {"gsa__outputs": ["nope"]}, "unknown output 'nope', allowed: RDef_A"),
        ("analysis_node", {"gsa__outputs": ["rms_nose_x"]}, "POINT one of cutterhead"),
        ("analysis_node", {"threshold": -1.0}, "threshold"),
        ("analysis_node", {"baseline": "never_made"}, "never_made"),
    ):
        (found,) = peer.set_parameters(f"/north/{node}", **values)
        assert reason in found


@pytest.mark.parametrize("node", ["load_node", "dynamics_node", "analysis_node"])
def test_every_parameter_is_described(machines, node):
    """Those of the other nodes: test_lifecycle."""
    peer = machines.peer
    vectors = {"sensor.bias", "sensor.mounting_rotation"} if node == "dynamics_node" else set()
    assert peer.check_parameters("/north", node) == vectors


def test_quality_of_service_by_parameter(machines):
    (offered,) = machines.peer.node.get_publishers_info_by_topic("/north/model/shield/accel")
    assert offered.qos_profile.reliability == ReliabilityPolicy.RELIABLE


def test_quality_of_service_that_does_not_match_is_said(machines, capfd):
    """By both sides; the subscriber, the load node of that machine, uses it all the same."""
    sent = machines.peer.node.create_publisher(JointState, "/south/operating_point", qos.LIVE)  # best effort
    said = []

    def heard():
        said.extend(capfd.readouterr().err.splitlines())
        return sent.get_subscription_count() and any("incompatible QoS" in line for line in said)

    machines.run_until(heard)
    (line,) = [line for line in said if "[WARNING]" in line]
    assert "operating_point: " in line
    assert "best effort, not reliable" in line


@pytest.mark.verify
def test_the_layouts_name_statuses_and_values_that_there_are(machines):
    """As PlotJuggler writes it: /topic/hardware_id/name/key."""
    peer = machines.peer
    studies = peer.listen(DiagnosticArray, "/north/analysis/gsa_status", qos.GSA)
    machines.run_until(lambda: studies)
    (study,) = [Status(status) for status in studies[0].status]
    curves = ElementTree.parse(LAYOUTS / "plotjuggler.xml").findall(".//curve")
    names = [curve.get("name") for curve in curves]
    for name in (name for name in names if name.startswith("/diagnostics/")):
        hardware, status, key = name.removeprefix("/diagnostics/").replace("tbm:", "north:").split("/")
        machines.run_until(lambda status=status, key=key: peer.value(status, key) is not None)
        assert peer.diagnostics[status].hardware == hardware
        float(peer.value(status, key))
    (done,) = [name for name in names if name.startswith("/tbm/analysis/gsa_status/")]
    hardware, status, key = done.removeprefix("/tbm/analysis/gsa_status/").replace("tbm:", "north:").split("/")
    assert (hardware, status) == (study.hardware, studies[0].status[0].name)
    assert study.values[key] == "0"
    panel = json.loads((LAYOUTS / "foxglove.json").read_text())["configById"]["DiagnosticStatusPanel!dynamics"]
    shown = peer.diagnostics[panel["selectedName"].replace("tbm:", "north:")]
    assert shown.hardware == panel["selectedHardwareId"]
