"""What a killed reader does to others: `python benchmarks/killed_readers.py [--duration 120]`.

One process sends blocks every 5 ms and a status every 100 ms, two read and answer every 2 ms, and this one watches the
status. Every 1.5 s a reader is killed (-9) and started again. Printed: the longest that the status stayed away, with
which neither reader has anything to do; over what rmw_fastrtps takes on one computer, shared memory, and over ours.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time

import rclpy
from rclpy.qos import QoSProfile
from std_msgs.msg import ByteMultiArray, String

from tbm_msgs_py.nodes.transport import avoid_shared_memory

BLOCK, RELIABLE = ByteMultiArray(data=[b"\0"] * 6000), QoSProfile(depth=50)
KILL_EVERY_S, WARM_UP_S = 1.5, 5.0


def send() -> None:
    """Send blocks, and the status that is watched."""
    node = rclpy.create_node("sender")
    blocks = node.create_publisher(ByteMultiArray, "blocks", RELIABLE)
    status = node.create_publisher(String, "status", RELIABLE)
    node.create_timer(0.005, lambda: blocks.publish(BLOCK))
    node.create_timer(0.1, lambda: status.publish(String(data="going")))
    rclpy.spin(node)


def read() -> None:
    """Read blocks and send some."""
    node = rclpy.create_node("reader")
    node.create_subscription(ByteMultiArray, "blocks", lambda _: None, RELIABLE)
    answers = node.create_publisher(ByteMultiArray, "answers", RELIABLE)
    node.create_timer(0.002, lambda: answers.publish(BLOCK))
    rclpy.spin(node)


def start(role: str) -> subprocess.Popen[bytes]:
    """Start a process of this file."""
    return subprocess.Popen([sys.executable, __file__, "--role", role])


def watch(duration: float) -> None:
    """Kill readers, and print the longest silence of the sender."""
    node = rclpy.create_node("watch")
    heard = [time.monotonic()]
    node.create_subscription(String, "status", lambda _: heard.append(time.monotonic()), RELIABLE)
    node.create_subscription(ByteMultiArray, "answers", lambda _: None, RELIABLE)
    sender, readers = start("send"), [start("read"), start("read")]
    begin = time.monotonic()
    kill_at, kills, longest = begin + WARM_UP_S, 0, 0.0
    try:
        while (now := time.monotonic()) < begin + duration:
            rclpy.spin_once(node, timeout_sec=0.01)
            longest = max(longest, now - heard[-1]) if kills else 0.0
            if now > kill_at:
                readers[kills % 2].kill()
                readers[kills % 2].wait()
                readers[kills % 2] = start("read")
                kill_at, kills = now + KILL_EVERY_S, kills + 1
    finally:
        for process in (sender, *readers):
            process.kill()
            process.wait()
    carried = "shared memory" if os.environ["FASTDDS_BUILTIN_TRANSPORTS"] else "UDP on loopback"
    print(f"{carried}: {kills} readers killed, longest silence of another process {longest:.2f} s")


def main() -> None:
    """Watch both ways, or play a role."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=120.0, help="s, of each way")
    parser.add_argument("--role", choices=["both", "watch", "send", "read"], default="both", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.role == "both":
        for theirs in ("DEFAULT", ""):
            environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
            environment["FASTDDS_BUILTIN_TRANSPORTS"] = theirs
            again = [sys.executable, __file__, "--role", "watch", "--duration", str(given.duration)]
            subprocess.run(again, env=environment, check=True)
        return
    avoid_shared_memory()
    rclpy.init()
    {"watch": lambda: watch(given.duration), "send": send, "read": read}[given.role]()


if __name__ == "__main__":
    main()
