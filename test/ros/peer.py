"""A node of the test process that listens, publishes, calls services and drives other nodes' lifecycles.

What a node does with a message, a clock or a transition is tested on the node itself, in this process: the peer hosts
it and spins it. What only a process can show (signals, kill -9, discovery, memory) is tested on processes.
"""

import gc
import math
import os
import sys
import time
from contextlib import AbstractContextManager, ExitStack, suppress
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import ChangeState, GetState
from processes import DEADLINE, ros_arguments, wait_for
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, ListParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor, TimeoutException
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.managed import STATUS_PERIOD
from tbm_msgs_py.nodes.parameters import node_parameters

NOT_OURS = ("qos_overrides", "use_sim_time", "start_type_description")  # parameters that rclpy declares
TRANSITIONS = {"configure": 1, "cleanup": 2, "activate": 3, "deactivate": 4}


class Logger:
    """Logger of a hosted node: keeps what it logs, a line each."""

    def __init__(self):
        self.lines = []

    def debug(self, message):
        """Nothing that a site sees."""

    def __getattr__(self, severity):
        def log(message):
            self.lines.append(f"[{severity.upper()}] {message}")
            sys.stderr.write(f"{self.lines[-1]}\n")  # pytest shows it where a test fails

        return log


class HostedNode:
    """A node in the test process; an error in a callback of it is one of the test, unless it is forgiven.

    After its first report an `asked_only` node says how it is by no timer.
    """

    asked_only = False

    def __init__(self, peer, factory, arguments, parameters):
        self._peer = peer
        self.node = factory(cli_args=ros_arguments(arguments, parameters))
        logger = Logger()
        self.node.get_logger = lambda: logger
        self._lines = logger.lines
        self._forgiven = 0
        peer.executor.add_node(self.node)
        self.started = self.node.start()

    @property
    def output(self):
        """What it logged."""
        return "\n".join(self._lines)

    def says(self, text):
        return text in self.output

    def wait_for(self, condition):
        """Wait until a condition holds, the node's statuses at hand without the second between them."""
        self._peer.wait_for(condition, step=self.report)

    def report(self):
        """Let it do what is due and say how it is.

        A status holds what was found since the last one: that of its timer, due at any moment on a busy computer,
        would take a fault away from the one that is waited for.
        """
        timer = next(timer for timer in self.node.timers if timer.timer_period_ns == STATUS_PERIOD * 1e9)
        timer.cancel()
        self._peer.settle()
        self.node.publish_statuses()
        self._peer.spin()
        self._peer.settle()
        if not self.asked_only:
            timer.reset()

    @property
    def ended(self):
        """Whether its process would have ended."""
        return self.node.ended.done()

    def close(self):
        """Release it as the end of its process would; once."""
        if self.node is None:
            return
        node, self.node = self.node, None
        node.finish()
        self._peer.executor.remove_node(node)
        node.destroy_node()
        assert node.failed_callbacks == self._forgiven, self.output

    def forgive(self):
        """Errors in its callbacks so far were the test's purpose."""
        self._forgiven = self.node.failed_callbacks


class Peer:
    """Context manager around a node in the contract's namespace."""

    def __enter__(self):
        rclpy.init()
        self.node = rclpy.create_node("peer", namespace="/tbm")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.diagnostics, self.said, self.levels = {}, {}, {}  # by status name: the latest, and every text and level
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, qos.DIAGNOSTICS)
        self._clients, self._hosted = {}, []
        return self

    def __exit__(self, *_):
        with ExitStack() as ending:  # one that complains keeps none from its end
            ending.callback(rclpy.try_shutdown)
            ending.callback(self.node.destroy_node)
            ending.callback(self.executor.shutdown)
            for hosted in self._hosted:
                ending.callback(hosted.close)
        self._clients = self.node = self.executor = None
        gc.collect()  # or its participant lives on, half taken apart, and services of the next one wait for it

    def _on_diagnostics(self, message):
        for status in message.status:
            self.diagnostics[status.name] = Status(status)
            self.said.setdefault(status.name, []).append(status.message)
            self.levels.setdefault(status.name, []).append(self.diagnostics[status.name].level)

    def host(self, factory, *arguments, **parameters):
        """Start a node in this process."""
        self._hosted.append(HostedNode(self, factory, arguments, parameters))
        return self._hosted[-1]

    def spin(self):
        self.executor.spin_once(timeout_sec=0.02)

    def settle(self):
        """Run every callback that is due, those that they cause included."""
        while self._pass():
            pass

    def _pass(self):
        """Number of callbacks that were due: of a subscription one, however many messages wait."""
        count = 0
        with suppress(TimeoutException):
            while True:
                handler, _, _ = self.executor.wait_for_ready_callbacks(timeout_sec=0.0)
                handler()
                handler.result()
                count += 1
        return count

    def spin_for(self, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.spin()

    def wait_for(self, condition, deadline=DEADLINE, step=None):
        try:
            wait_for(condition, deadline, step or self.spin)
        except AssertionError as error:
            raise AssertionError(f"{error}; on /diagnostics:\n{self._heard()}") from None

    def _heard(self):
        now = time.monotonic()
        return "\n".join(f"{now - s.came:5.1f} s ago: {n}: {s.level} {s.message}" for n, s in self.diagnostics.items())

    def listen(self, kind, topic, profile):
        """List that fills with what comes."""
        received = []
        self.node.create_subscription(kind, topic, received.append, profile)
        return received

    def publisher(self, kind, topic, profile, matched=1):
        """Publisher that has its subscribers."""
        made = self.node.create_publisher(kind, topic, profile)
        self.wait_for(lambda: made.get_subscription_count() >= matched)
        return made

    def call(self, kind, name, request=None, deadline=DEADLINE):
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        client = self._clients[name]
        self.wait_for(client.service_is_ready)
        future = client.call_async(request or kind.Request())
        self.wait_for(future.done, deadline)
        return future.result()

    def value(self, status, key):
        """Latest value on `/diagnostics`; None while there is none."""
        return self.diagnostics[status].values.get(key) if status in self.diagnostics else None

    def text(self, status):
        return self.diagnostics[status].message if status in self.diagnostics else ""

    def set_parameters(self, node, **values):
        """Reasons why parameters were not set; dots of a name are double underscores."""
        request = SetParameters.Request()
        for name, value in values.items():
            request.parameters.append(Parameter(name.replace("__", "."), value=value).to_parameter_msg())
        results = self.call(SetParameters, f"{node}/set_parameters", request).results
        return [result.reason for result in results if not result.successful]

    def check_parameters(self, namespace, node):
        """Hold a node's declarations against what every parameter has to say; names of its vectors.

        ROS has ranges of single numbers only: a node looks at the numbers of its vectors itself.
        """
        names = self.call(ListParameters, f"{namespace}/{node}/list_parameters").result.names
        own = [name for name in names if not name.startswith(NOT_OURS)]
        known = node_parameters(node)
        assert set(own) == set(known)
        request = DescribeParameters.Request(names=own)
        found = self.call(DescribeParameters, f"{namespace}/{node}/describe_parameters", request).descriptors
        for described in found:
            assert described.description, described.name
            assert described.additional_constraints, described.name
            assert described.read_only == (known[described.name].changes == "start"), described.name
            ranges = [*described.integer_range, *described.floating_point_range]
            if described.type in (ParameterType.PARAMETER_INTEGER, ParameterType.PARAMETER_DOUBLE):
                (limits,) = ranges
                assert -math.inf < limits.from_value < limits.to_value, described.name
        vectors = (ParameterType.PARAMETER_INTEGER_ARRAY, ParameterType.PARAMETER_DOUBLE_ARRAY)
        return {described.name for described in found if described.type in vectors}

    def transition(self, node, name):
        request = ChangeState.Request()
        if name == "shutdown":  # an id for each state that it starts from, but one label
            request.transition.label = name
        else:
            request.transition.id = TRANSITIONS[name]
        return self.call(ChangeState, f"{node}/change_state", request).success

    def state(self, node):
        return self.call(GetState, f"{node}/get_state").current_state.label


class Rig(AbstractContextManager):
    """A publisher of others: in a context, and so a participant, of its own, in no namespace, never spun."""

    def __init__(self, kind, topic, profile, name="rig"):
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node(name, context=self._context)
        self._publisher = self._node.create_publisher(kind, topic, profile)
        self.publish = self._publisher.publish

    @property
    def matched(self):
        """Subscriptions that it has."""
        return self._publisher.get_subscription_count()

    def close(self):
        self._node.destroy_node()
        self._context.try_shutdown()

    def __exit__(self, *_):
        self.close()


class SimulatedClock:
    """`/clock` of a peer, for nodes with `use_sim_time`: time passes when the test says so."""

    def __init__(self, peer, start_ns):
        self._peer, self.now_ns = peer, start_ns
        self._publisher = peer.node.create_publisher(Clock, "/clock", qos.CLOCK)
        self.tick(0.0)

    def tick(self, seconds=0.01):
        """Let a moment pass and everything happen that is due then."""
        self.now_ns += round(seconds * 1e9)
        self._publisher.publish(messages.clock(self.now_ns))
        self._peer.settle()

    def run_until(self, condition):
        self._peer.wait_for(condition, step=self.tick)

    def run_for(self, seconds):
        for _ in range(round(seconds / 0.01)):
            self.tick()


class Status:
    """One status of `/diagnostics`."""

    def __init__(self, status):
        self.level = int.from_bytes(status.level, "little")
        self.message = status.message
        self.hardware = status.hardware_id
        self.values = {pair.key: pair.value for pair in status.values}
        self.came = time.monotonic()


def stamps(received):
    return [messages.stamp_to_ns(message.header.stamp) for message in received]


def children(pid):
    """Ids of the processes below a process, at any depth."""
    found = []
    try:
        tasks = list(Path(f"/proc/{pid}/task").iterdir())
        direct = [int(child) for task in tasks for child in (task / "children").read_text().split()]
    except (FileNotFoundError, ProcessLookupError):
        return found
    for child in direct:
        found += [child, *children(child)]
    return found


def alive(pid):
    """Whether a process is there and no zombie."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


def command_line(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
    except (FileNotFoundError, ProcessLookupError):
        return []
