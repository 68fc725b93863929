"""Messages on this computer: over sockets that nobody else reaches, not memory that a killed process could hold up."""

import os
import re
from pathlib import Path

import psutil
import pytest

rclpy = pytest.importorskip("rclpy")

from peer import Peer  # noqa: E402

from tbm_msgs_py.nodes.transport import LOOPBACK, avoid_shared_memory  # noqa: E402

pytestmark = pytest.mark.ros

RANGE, TRANSPORTS = "ROS_AUTOMATIC_DISCOVERY_RANGE", "FASTDDS_BUILTIN_TRANSPORTS"
PROFILES, IMPLEMENTATION = "FASTRTPS_DEFAULT_PROFILES_FILE", "RMW_IMPLEMENTATION"
NEW_PROFILES, PEERS = "FASTDDS_DEFAULT_PROFILES_FILE", "ROS_STATIC_PEERS"
NAMES = (RANGE, TRANSPORTS, PROFILES, IMPLEMENTATION, NEW_PROFILES, PEERS)
OURS = {RANGE: "SYSTEM_DEFAULT", PROFILES: str(LOOPBACK), IMPLEMENTATION: "rmw_fastrtps_cpp"}


@pytest.fixture
def stated():
    """Set the environment to these settings and no other of them; it is as it was afterwards."""
    before = dict(os.environ)

    def state(settings):
        for name in NAMES:
            os.environ.pop(name, None)
        os.environ.update(settings)

    yield state
    os.environ.clear()
    os.environ.update(before)


@pytest.mark.parametrize("theirs", [{}, {TRANSPORTS: "DEFAULT"}])
def test_nodes_meet_and_share_memory_only_when_told_to(run_node, stated, theirs):
    """A node as we start it and one with the transports of rmw_fastrtps, found by a peer as we start it."""
    with Peer() as peer:
        stated({RANGE: "LOCALHOST", **theirs})
        node = run_node("load_node").process.pid
        peer.wait_for(lambda: "tbm: loads" in peer.diagnostics)
        assert peer.state("/tbm/load_node") == "active"
        shared = {pid: "/dev/shm/fastrtps_" in Path(f"/proc/{pid}/maps").read_text() for pid in (os.getpid(), node)}
        assert shared == {os.getpid(): False, node: bool(theirs)}
        if not theirs:
            sockets = psutil.Process(node).net_connections("udp")
            assert {socket.laddr.ip for socket in sockets} == {"127.0.0.1"}


def firewalled():
    """Ports of the rule that the documentation gives."""
    text = (Path(__file__).parents[2] / "docs" / "operation.md").read_text(encoding="utf-8")
    low, high = re.search(r"ufw deny proto udp from any to any port (\d+):(\d+)", text).groups()
    return range(int(low), int(high) + 1)


def test_the_firewall_rule_names_every_port_of_rtps():
    """DDSI-RTPS 2.5, 9.6.2: PB + DG * domain + offset + PG * participant, with its defaults."""
    ports = {7400 + 250 * domain + offset for domain in range(233) for offset in (0, 1)}
    ports |= {7400 + 250 * domain + 10 + 2 * n + one for domain in range(232) for n in range(119) for one in (0, 1)}
    assert ports <= set(firewalled())


def test_the_firewall_rule_names_every_open_port(run_node, stated):
    """What a node of the default range, the subnet, really listens on: Fast DDS has ports of its own beside RTPS's."""
    stated({RANGE: "SUBNET"})
    node = run_node("load_node")
    with Peer() as peer:
        peer.wait_for(lambda: "tbm: loads" in peer.diagnostics)
        sockets = psutil.Process(node.process.pid).net_connections("udp")
        assert {socket.laddr.ip for socket in sockets} > {"0.0.0.0"}
        assert {socket.laddr.port for socket in sockets} <= set(firewalled())


@pytest.mark.parametrize(
    ("given", "settled"),
    [
        ({RANGE: "LOCALHOST"}, OURS),
        (
            {RANGE: "LOCALHOST", IMPLEMENTATION: "rmw_fastrtps_dynamic_cpp"},
            {**OURS, IMPLEMENTATION: "rmw_fastrtps_dynamic_cpp"},
        ),
        ({}, {TRANSPORTS: "UDPv4"}),
        ({RANGE: "SUBNET"}, {RANGE: "SUBNET", TRANSPORTS: "UDPv4"}),
        *(
            (said, said)
            for said in (
                {RANGE: "LOCALHOST", TRANSPORTS: "DEFAULT"},
                {RANGE: "LOCALHOST", PROFILES: "site.xml"},
                {RANGE: "LOCALHOST", NEW_PROFILES: "site.xml"},
                {RANGE: "LOCALHOST", PEERS: "10.0.0.7"},
                {RANGE: "LOCALHOST", IMPLEMENTATION: "rmw_cyclonedds_cpp"},
            )
        ),
    ],
)
def test_what_somebody_said_holds(stated, given, settled):
    stated(given)
    for _ in range(2):  # a process that was started by one of ours settles nothing anew
        avoid_shared_memory()
        assert {name: os.environ[name] for name in NAMES if name in os.environ} == settled
