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
from tbm_msgs_py.nodes import messages, qos  # noqa: E402
from tbm_msgs_py.operating_point import from_joint_state  # noqa: E402

pytestmark = pytest.mark.ros

TOPIC = "/tbm/loads/operating_point"
POINT = OperatingPoint(0.5, 2.0e6, 1.0e7, 0.25)


def test_a_client_gets_what_is_published(run_node):
    with Peer() as peer:
        sent = peer.node.create_publisher(JointState, TOPIC, qos.OPERATING_POINT)
        view = run_node("tbm_gsa.nodes.live_view", port=0)
        peer.wait_for(lambda: sent.get_subscription_count() == 1)
        port = re.search(r"ws://127\.0\.0\.1:(\d+)", view.output).group(1)
        with client.connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"]) as connection:
            channels = {}
            while TOPIC not in channels:
                told = connection.recv(DEADLINE)
                if isinstance(told, str) and (document := json.loads(told))["op"] == "advertise":
                    channels |= {channel["topic"]: channel for channel in document["channels"]}
            channel = channels[TOPIC]
            assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
            assert channel["schemaName"] == "sensor_msgs/msg/JointState"
            assert "float64[] effort" in channel["schema"]
            asked = {"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channel["id"]}]}
            connection.send(json.dumps(asked))
            data = None
            while data is None:
                sent.publish(messages.operating_point_message(5, POINT))
                peer.spin_for(0.05)
                data = next_data(connection)
    opcode, subscription, _ = struct.unpack_from("<BIQ", data)
    assert (opcode, subscription) == (1, 7)
    assert from_joint_state(deserialize_message(data[13:], JointState)) == POINT


def next_data(connection):
    """Message data that has come; None if there is none."""
    try:
        received = connection.recv(0.05)
    except TimeoutError:
        return None
    return received if isinstance(received, bytes) and received[0] == 1 else None
