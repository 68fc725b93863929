"""`tbm-monitor bag info` of recordings that the mcap library wrote."""

import json

import pytest
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter

COUNTS = {"std_msgs/msg/String": 3, "std_msgs/msg/Int32": 2}


@pytest.mark.parametrize("index", [IndexType.ALL, IndexType.NONE])
def test_each_type_of_a_topic_is_shown_and_said(command, tmp_path, index):
    with (tmp_path / "two.mcap").open("wb") as file:
        writer = McapWriter(file, compression=CompressionType.NONE, index_types=index)
        writer.start("ros2", "test")
        for kind, count in COUNTS.items():
            schema = writer.register_schema(kind, "ros2msg", b"")
            channel = writer.register_channel("/mixed", "cdr", schema)
            for n in range(count):
                writer.add_message(channel, n, b"\0\1\0\0\0\0\0\0", n)
        channel = writer.register_channel("/plain", "cdr", schema)
        writer.add_message(channel, 0, b"\0\1\0\0\0\0\0\0", 0)
        writer.finish()
    code, out, err = command("bag", "info", "two.mcap", "--json")
    assert code == 0, err
    topics = json.loads(out)["topics"]
    assert topics["/mixed"] == {"type": "std_msgs/msg/String", "types": COUNTS, "messages": 5}
    assert topics["/plain"]["types"] == {"std_msgs/msg/Int32": 1}
    out = command("bag", "info", "two.mcap")[1]
    rows = [line.split() for line in out.splitlines()]
    assert all(["/mixed", kind, str(count)] in rows for kind, count in COUNTS.items())
    assert "/mixed: 2 types, where ROS has one a topic; each is shown" in out
    assert "/plain: " not in out
