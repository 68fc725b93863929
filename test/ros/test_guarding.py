"""An error in a callback ends no node: it is in the log and on `/diagnostics`, and the node goes on."""

import pytest

rclpy = pytest.importorskip("rclpy")

from peer import Peer, SimulatedClock  # noqa: E402
from rcl_interfaces.msg import Parameter, ParameterValue  # noqa: E402
from rcl_interfaces.srv import SetParameters  # noqa: E402
from std_msgs.msg import Int32  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from tbm_msgs_py.nodes import guarding  # noqa: E402
from tbm_msgs_py.nodes.managed import ManagedNode  # noqa: E402
from tbm_msgs_py.nodes.parameters import NodeSettings  # noqa: E402

pytestmark = pytest.mark.ros

NODE, STATUS = "/tbm/fragile", "tbm: fragile"
OK, WARN, ERROR = range(3)
NO_TYPE = SetParameters.Request(parameters=[Parameter(name="autostart", value=ParameterValue(type=99))])


class Fragile(ManagedNode):
    """Node that does not expect a number below zero, nor to be asked anything."""

    def __init__(self, **options):
        super().__init__("fragile", NodeSettings, **options)
        self.taken, self.ill = [], False

    def configure(self):
        self.create_subscription(Int32, "number", self._on_number, 10)
        self.create_service(Trigger, "ask", self._on_ask)

    def statuses(self):
        if self.ill:
            raise IndexError("ill")
        return []

    def _on_number(self, message):
        if message.data < 0:
            raise KeyError(message.data)
        self.taken.append(message.data)

    def _on_ask(self, _request, _response):
        raise RuntimeError("nobody\nasks")


def own(peer):
    """Level, text and count of the node's own status."""
    status = peer.diagnostics[STATUS]
    return status.level, status.message, int(status.values["failed_callbacks"])


def test_an_error_in_a_callback_is_said_and_work_goes_on(host_node, peer):
    node = host_node(Fragile)
    node.wait_for(lambda: STATUS in peer.diagnostics and own(peer) == (OK, "active", 0))
    numbers = peer.publisher(Int32, "/tbm/number", 10)
    for number in (1, -1, -1, 2):
        numbers.publish(Int32(data=number))
    node.wait_for(lambda: node.node.taken == [1, 2])
    reason = "unexpected error in on_number: KeyError: -1"
    assert (ERROR, f"active; {reason}") in zip(peer.levels[STATUS], peer.said[STATUS], strict=True)
    node.wait_for(lambda: own(peer) == (OK, "active", 2))  # over when it is over
    assert node.output.splitlines().count(f"[ERROR] {reason}") == 1  # a line a minute

    assert not peer.call(Trigger, "/tbm/ask").success
    node.wait_for(lambda: own(peer) == (OK, "active", 3))
    assert "unexpected error in on_ask: RuntimeError: nobody asks" in node.output.splitlines()[-1]
    assert peer.state(NODE) == "active"
    node.forgive()


def test_a_status_that_fails_does_not_silence_the_node(host_node, peer):
    node = host_node(Fragile)
    node.node.ill = True
    text = "active; unexpected error in statuses: IndexError: ill"
    node.wait_for(lambda: peer.text(STATUS) == text)
    assert peer.diagnostics[STATUS].level == ERROR
    node.node.ill = False
    node.wait_for(lambda: own(peer)[:2] == (OK, "active"))
    node.forgive()


def test_no_clock_and_no_parameter_of_others_ends_a_node(host_node, peer):
    """Before the epoch, and of a type that there is not: rclpy's own callbacks do not expect them."""
    node = host_node(Fragile, use_sim_time=True)
    clock = SimulatedClock(peer, -5 * 10**9)
    node.wait_for(lambda: node.node.failed_callbacks)
    assert node.says("unexpected error in clock_callback: ValueError: Seconds value must not be negative")
    before = node.node.failed_callbacks
    assert peer.call(SetParameters, f"{NODE}/set_parameters", NO_TYPE).results == []
    assert node.node.failed_callbacks == before + 1
    clock.tick(10.0)
    node.wait_for(lambda: node.node.get_clock().now().nanoseconds == 5 * 10**9)
    assert peer.state(NODE) == "active"
    node.forgive()


def test_a_timer_that_fails_every_time_is_said_once(host_node, monkeypatch):
    monkeypatch.setattr(guarding, "CALLS", 3)
    monkeypatch.setattr(guarding, "SECONDS", 0.0)
    node = host_node(Fragile)
    calls = []

    def tick():
        calls.append(None)
        if len(calls) % 3:  # not every time, at first
            raise KeyError("tick")

    timer = node.node.create_steady_timer(0.001, tick)
    node.wait_for(lambda: len(calls) > 9)
    assert "fails every time" not in node.output
    node.node.destroy_timer(timer)
    before = node.node.failed_callbacks
    node.node.create_steady_timer(0.001, lambda: {}["tick"])
    node.wait_for(lambda: node.node.failed_callbacks > before + 9)
    fatal = [line for line in node.output.splitlines() if line.startswith("[FATAL]")]
    assert fatal == ["[FATAL] unexpected error in <lambda>: KeyError: 'tick'; it fails every time"]
    node.forgive()


def test_a_hosted_node_with_such_an_error_fails_its_test():
    with pytest.raises(AssertionError, match="KeyError: -1"), Peer() as peer:
        node = peer.host(Fragile)
        peer.publisher(Int32, "/tbm/number", 10).publish(Int32(data=-1))
        peer.wait_for(lambda: node.node.failed_callbacks)
    assert not rclpy.ok()
