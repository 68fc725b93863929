"""The executor of an rclpy that has no events executor: weeks of callbacks leave nothing behind."""

from types import SimpleNamespace

import pytest

rclpy = pytest.importorskip("rclpy")
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.task import Future  # noqa: E402

from tbm_msgs_py.nodes.running import _turn  # noqa: E402

pytestmark = pytest.mark.ros


def test_turns_of_the_executor_leave_nothing_behind():
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node, executor = rclpy.create_node("busy", context=context), SingleThreadedExecutor(context=context)
    try:
        ran = []
        node.create_timer(0.001, lambda: ran.append(1))
        executor.add_node(node)
        watched = SimpleNamespace(ended=Future(executor=executor))
        while len(ran) < 50:
            _turn(executor, watched)
        assert not watched.ended._callbacks
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
