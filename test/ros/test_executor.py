"""What our use of rclpy's executors makes up for."""

from types import SimpleNamespace

import pytest

rclpy = pytest.importorskip("rclpy")
from rclpy.exceptions import InvalidHandle  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.task import Future  # noqa: E402

from tbm_msgs_py.nodes.running import _turn  # noqa: E402

pytestmark = pytest.mark.ros


def test_an_event_for_what_a_callback_has_destroyed_ends_no_node():
    """The events executor raises for it, some 10 times in 4000 subscriptions made anew, and goes on when asked."""
    asked = []

    def spin(until, timeout_sec):
        asked.append(until)
        raise InvalidHandle("cannot use Destroyable because destruction was requested")

    node = SimpleNamespace(ended=object())
    _turn(SimpleNamespace(spin_until_future_complete=spin), node)
    assert asked == [node.ended]


def test_turns_of_the_executor_leave_nothing_behind():
    """That of an rclpy that has no events executor, in weeks of callbacks."""
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
