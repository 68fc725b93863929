"""Two machines side by side, each in its namespace; parameters at run time; quality of service by parameter."""

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from geometry_msgs.msg import AccelStamped  # noqa: E402
from peer import Peer, stamps  # noqa: E402
from rcl_interfaces.srv import DescribeParameters, ListParameters  # noqa: E402
from rclpy.qos import ReliabilityPolicy  # noqa: E402
from sensor_msgs.msg import JointState, PointCloud2  # noqa: E402

from tbm_dynamics import load_machine, simulate  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402
from tbm_msgs_py.operating_point import from_joint_state  # noqa: E402

pytestmark = pytest.mark.ros

LOAD_NODE, DYNAMICS_NODE = "tbm_dynamics.nodes.load_node", "tbm_dynamics.nodes.dynamics_node"
ANALYSIS_NODE = "tbm_gsa.nodes.analysis_node"
SEEDS = {"north": 1, "south": 2}
STEP_NS = 200_000


@pytest.fixture(scope="module")
def nodes(tmp_path_factory):
    """A peer, and the processes of both machines by namespace and name."""
    from conftest import node_runner

    with Peer() as peer, node_runner(tmp_path_factory.mktemp("nodes")) as run_node:
        blocks = {}
        for name in SEEDS:
            for topic in ("loads/block", "model/mesh_forces"):
                blocks[name, topic] = peer.listen(PointCloud2, f"/{name}/{topic}", qos.BLOCK)
        started = {}
        for name, seed in SEEDS.items():
            quality = {f"qos_overrides./{name}/model/shield/accel.publisher.reliability": "reliable"}
            quality |= {f"qos_overrides./{name}/model/mesh_forces.publisher.depth": 200}
            remapped = ("-r", f"__ns:=/{name}")
            started[name, "dynamics_node"] = run_node(DYNAMICS_NODE, *remapped, seed=seed, **quality)
            started[name, "load_node"] = run_node(LOAD_NODE, *remapped, seed=seed, wait_for_subscribers=2)
        started["north", "analysis_node"] = run_node(ANALYSIS_NODE, "-r", "__ns:=/north")
        yield peer, started, blocks


def test_two_machines_do_not_meet(nodes):
    peer, _, blocks = nodes
    peer.wait_for(lambda: all(len(received) > 20 for received in blocks.values()))
    for name, seed in SEEDS.items():
        epoch, moved = stamps(blocks[name, "loads/block"])[0], blocks[name, "model/mesh_forces"][:20]
        # The peer may have found the mesh forces late: from wherever they begin.
        response = simulate(load_machine("dz101"), duration=(stamps(moved)[-1] - epoch) / 1e9 + 0.05, seed=seed)
        for message in moved:
            block = messages.block_from(message)
            first = (block.stamp_ns - epoch) // STEP_NS
            assert np.array_equal(block.values, response.mesh_force[::2][first : first + 250]), name
    wanted = {f"{name}: {task}" for name in SEEDS for task in ("dynamics", "loads")}
    peer.wait_for(lambda: wanted | {"north: comparison shield"} <= set(peer.diagnostics))
    assert not [name for name in peer.diagnostics if name.startswith("tbm:")]


def test_parameters_at_run_time(nodes):
    peer, _, _ = nodes
    points = peer.listen(JointState, "/north/loads/operating_point", qos.OPERATING_POINT)
    accels = peer.listen(AccelStamped, "/north/model/shield/accel", qos.LIVE)
    peer.wait_for(lambda: points and accels)
    assert not peer.set_parameters("/north/load_node", operating_point__torque=2000.0, operating_point__thrust=9000.0)
    peer.wait_for(lambda: len(points) == 2)
    applied = from_joint_state(points[1])
    assert (applied.torque, applied.thrust) == (2.0e6, 9.0e6)
    assert applied.speed == load_machine("dz101").operating_point.speed
    assert not peer.set_parameters("/north/dynamics_node", live_rate=20.0)
    peer.wait_for(lambda: np.diff(stamps(accels))[-3:].tolist() == [50_000_000] * 3)
    assert not peer.set_parameters("/north/analysis_node", threshold=0.5, window=1.0, alarm_axes=["x", "z"])

    for node, values, reason in (
        ("load_node", {"operating_point__speed": 1e6}, "speed"),
        ("dynamics_node", {"live_rate": 5000.0}, "live_rate"),
        ("dynamics_node", {"block_rate": 1000}, "fixed while the node is configured; clean up, set, configure"),
        ("dynamics_node", {"autostart": False}, "read-only"),
        ("analysis_node", {"alarm_axes": ["w"]}, "allowed: one or more of x, y, z"),
        ("analysis_node", {"threshold": -1.0}, "threshold"),
        ("analysis_node", {"baseline": "never_made"}, "never_made"),
    ):
        (found,) = peer.set_parameters(f"/north/{node}", **values)
        assert reason in found


@pytest.mark.parametrize("node", ["load_node", "dynamics_node", "analysis_node"])
def test_every_parameter_is_described(nodes, node):
    peer, _, _ = nodes
    names = peer.call(ListParameters, f"/north/{node}/list_parameters").result.names
    own = [name for name in names if not name.startswith(("qos_overrides", "use_sim_time", "start_type_description"))]
    assert {"autostart", "machine"} <= set(own)
    request = DescribeParameters.Request(names=own)
    for described in peer.call(DescribeParameters, f"/north/{node}/describe_parameters", request).descriptors:
        assert described.description, described.name
        assert described.additional_constraints, described.name
        assert described.read_only == (described.name == "autostart"), described.name


def test_quality_of_service_by_parameter_and_one_that_does_not_match(nodes):
    peer, started, _ = nodes
    topic = "/north/model/shield/accel"
    (offered,) = peer.node.get_publishers_info_by_topic(topic)
    assert offered.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    peer.node.create_publisher(JointState, "/south/operating_point", qos.LIVE)  # best effort
    load_node = started["south", "load_node"]
    peer.wait_for(lambda: load_node.says("incompatible QoS"))
    (line,) = [line for line in load_node.output.splitlines() if "incompatible QoS" in line]
    assert "[south.load_node]" in line
    assert "'operating_point'" in line
    assert "RELIABILITY" in line
