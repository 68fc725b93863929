"""A block from one process to another: the check of ROS by `doctor`."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import PointCloud2

from tbm_msgs_py import ACCELERATION
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.topics import NAMESPACE

_TOPIC = "topic"  # parameter of the sender
_PERIOD_S = 0.1
_LOOK_S = 0.1
_SAMPLES = 250  # as many as a block of a sensor has by default


@dataclass(frozen=True)
class Received:
    """What received of it.

    Attributes
    ----------
    discovered : bool
        The sender was seen.
    seconds : float or None
        Until its first block was here; None without one.
    """

    discovered: bool
    seconds: float | None


def main() -> int:
    """Publish a block ten times a second on the topic that the parameter `topic` names, until a signal."""
    with suppress(ExternalShutdownException, KeyboardInterrupt):
        rclpy.init()
        node = Node("doctor_sender", namespace=NAMESPACE)
        publisher = node.create_publisher(PointCloud2, node.declare_parameter(_TOPIC, "").value, qos.BLOCK)
        offsets = np.arange(_SAMPLES) / 5000.0
        message = messages.block(ACCELERATION, 0, offsets, np.zeros((_SAMPLES, len(ACCELERATION.channels))))
        node.create_timer(_PERIOD_S, lambda: publisher.publish(message))
        rclpy.spin(node)
    rclpy.try_shutdown()
    return 0


def receive_block(topic: str, patience: float, look: Callable[[], None], clock: Callable[[], float]) -> Received:
    """Wait for a block of another process.

    Parameters
    ----------
    topic : str
        Absolute name.
    patience : float
        Longest wait, s.
    look : callable
        Called now and then; raises when the other process has ended.
    clock : callable
        Seconds.
    """
    start = clock()
    # Ctrl-C stays with the command line, which ends the other process.
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = Node("doctor", namespace=NAMESPACE)
        received: list[PointCloud2] = []
        node.create_subscription(PointCloud2, topic, received.append, qos.BLOCK)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not received and clock() - start < patience:
            look()
            executor.spin_once(timeout_sec=_LOOK_S)
        seconds = clock() - start if received else None
        return Received(bool(received) or node.count_publishers(topic) > 0, seconds)
    finally:
        rclpy.try_shutdown()
