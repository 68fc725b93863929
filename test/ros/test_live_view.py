"""`live_view` as a process: a client of its WebSocket gets the messages as they were published."""

import json
import re
import struct

import pytest

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("foxglove")
client = pytest.importorskip("websockets.sync.client")

from peer import Peer  # noqa: E402
from processes import DEADLINE  # noqa: E402
from rclpy.serialization import deserialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402

from tbm_msgs_py import OperatingPoint  # noqa: E402
from tbm_msgs_py.base.operating_point import from_joint_state  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402

pytestmark = pytest.mark.ros

TOPIC = "/tbm/loads/operating_point"
POINT, OTHER = OperatingPoint(0.5, 2.0e6, 1.0e7, 0.25), OperatingPoint(0.6, 2.0e6, 1.0e7, 0.25)


def test_clients_get_what_is_published_and_what_was_latched(run_node):
    """Whenever they come; nothing is published for the later one."""
    with Peer() as peer:
        sent = peer.node.create_publisher(JointState, TOPIC, qos.OPERATING_POINT)
        sent.publish(messages.operating_point_message(5, POINT))
        view = run_node("live_view", port=0)
        peer.wait_for(lambda: sent.get_subscription_count() == 1)
        port = re.search(r"ws://127\.0\.0\.1:(\d+)", view.output).group(1)
        for latched in (POINT, OTHER):
            with client.connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"]) as connection:
                subscribe(connection, TOPIC)
                assert next_point(connection) == latched
                sent.publish(messages.operating_point_message(6, OTHER))
                while next_point(connection) != OTHER:
                    pass


def subscribe(connection, topic):
    """Wait for a topic and subscribe to it."""
    channels = {}
    while topic not in channels:
        told = connection.recv(DEADLINE)
        if isinstance(told, str) and (document := json.loads(told))["op"] == "advertise":
            channels |= {channel["topic"]: channel for channel in document["channels"]}
    channel = channels[topic]
    assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
    assert channel["schemaName"] == "sensor_msgs/msg/JointState"
    assert "float64[] effort" in channel["schema"]
    asked = {"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channel["id"]}]}
    connection.send(json.dumps(asked))


def next_point(connection):
    """Operating point of the next message that comes."""
    received = ""
    while isinstance(received, str) or received[0] != 1:
        received = connection.recv(DEADLINE)
    opcode, subscription, _ = struct.unpack_from("<BIQ", received)
    assert (opcode, subscription) == (1, 7)
    return from_joint_state(deserialize_message(received[13:], JointState))
