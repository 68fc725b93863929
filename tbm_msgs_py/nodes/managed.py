"""Base of every node: a lifecycle node that starts itself, declares its parameters strictly and ends cleanly."""

from __future__ import annotations

import functools
import math
import signal
import threading
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.logging import get_logger
from rclpy.task import Future

from tbm_msgs_py.topics import NAMESPACE

# A bounded wait: `EventsExecutor.spin()` without one can turn in place and hold the interpreter.
WAIT = 1.0  # s

_KINDS = {bool: "true or false", int: "a whole number", float: "a decimal number", str: "text", list: "a list"}
ParameterValue = bool | int | float | str | list[str] | list[float]


class ParameterError(ValueError):
    """A parameter given a value that is not allowed, in one line."""


@dataclass(frozen=True)
class Parameter:
    """Declaration of one ROS parameter; its type is that of the default.

    Attributes
    ----------
    name : str
        Name, dots for groups.
    default : bool, int, float, str or list
        Default. An empty list of strings is ``[""]``: ROS cannot type an empty one.
    description : str
        One line for the user, with the unit.
    minimum, maximum : float, optional
        Allowed range of a number, ends included.
    choices : tuple of str
        Allowed values of a string.
    read_only : bool
        Can be set at the start only.
    """

    name: str
    default: ParameterValue
    description: str
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = True

    def descriptor(self) -> ParameterDescriptor:
        """Descriptor with range, description and read-only flag."""
        described = ParameterDescriptor(
            description=self.description,
            read_only=self.read_only,
            additional_constraints=f"one of: {', '.join(self.choices)}" if self.choices else "",
        )
        if self.minimum is None and self.maximum is None:
            return described
        if isinstance(self.default, int):
            lowest = -(2**63) if self.minimum is None else int(self.minimum)
            highest = 2**63 - 1 if self.maximum is None else int(self.maximum)
            described.integer_range = [IntegerRange(from_value=lowest, to_value=highest, step=0)]
        else:
            low, high = self._float_limits()
            described.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
        return described

    def problem(self, value: Any) -> str | None:
        """Name what is wrong with a value of the right type, in one line; None when it is allowed."""
        low, high = self._float_limits()
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if (self.choices and value not in self.choices) or (
            number and not (math.isfinite(value) and low <= value <= high)
        ):
            return f"parameter {self.name}: {value}, allowed: {self.allowed()}"
        return None

    def allowed(self) -> str:
        """Type and range in words."""
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        kind = _KINDS[type(self.default)]
        low, high = self._float_limits()
        return kind if math.isinf(low) and math.isinf(high) else f"{kind} from {low:g} to {high:g}"

    def _float_limits(self) -> tuple[float, float]:
        low = -math.inf if self.minimum is None else float(self.minimum)
        high = math.inf if self.maximum is None else float(self.maximum)
        return low, high


AUTOSTART = Parameter("autostart", True, "configure and activate at the start, without a lifecycle manager")


class ManagedNode(LifecycleNode):  # type: ignore[misc]  # rclpy is untyped
    """Lifecycle node whose work is in four hooks: `configure`, `activate`, `deactivate`, `cleanup`.

    A hook that raises ValueError or OSError fails its transition with that line in the log. `deactivate` and `cleanup`
    also run when the process ends, the context may be gone by then: they release resources and publish nothing.

    Parameters
    ----------
    name : str
        Default node name.
    parameters : sequence of Parameter
        Declared beside `autostart`.
    namespace : str
        Default namespace.
    """

    def __init__(self, name: str, parameters: Sequence[Parameter] = (), *, namespace: str = NAMESPACE) -> None:
        super().__init__(name, namespace=namespace)
        self._survive_bad_transitions()
        self.exit_code = 0
        self.ended = Future()
        self._stage = 0  # 0 unconfigured, 1 inactive, 2 active
        self._declared = {parameter.name: parameter for parameter in (AUTOSTART, *parameters)}
        self.add_on_set_parameters_callback(self._check)
        for parameter in self._declared.values():
            self._declare(parameter)

    def _survive_bad_transitions(self) -> None:
        """Answer a transition that the state does not have with `success: false`; rclpy would end the process."""
        service = self._service_change_state
        change = service.callback

        def answer(request: Any, response: Any) -> Any:
            try:
                return change(request, response)
            except RuntimeError:  # rcl has logged which one
                response.success = False
                return response

        service.callback = answer

    def value(self, name: str) -> Any:
        """Value of a declared parameter; lists of strings come without empty entries."""
        value = self.get_parameter(name).value
        return [entry for entry in value if entry != ""] if isinstance(value, list) else value

    @property
    def active(self) -> bool:
        """Between `activate` and `deactivate`."""
        return self._stage == 2

    def create_subscription(
        self, kind: Any, topic: str, callback: Callable[..., None], *args: Any, **kwargs: Any
    ) -> Any:
        """Subscription as rclpy's; a callback that a shutdown cuts short ends without a trace."""
        return super().create_subscription(kind, topic, self._until_shutdown(callback), *args, **kwargs)

    def create_service(self, kind: Any, name: str, callback: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        """Service as rclpy's; a callback that a shutdown cuts short ends without a trace."""
        return super().create_service(kind, name, self._until_shutdown(callback), *args, **kwargs)

    def create_timer(self, period: float, callback: Callable[..., None], *args: Any, **kwargs: Any) -> Any:
        """Timer as rclpy's; a callback that a shutdown cuts short ends without a trace."""
        return super().create_timer(period, self._until_shutdown(callback), *args, **kwargs)

    def create_status_timer(self, callback: Callable[[], None]) -> Any:
        """Timer at 1 Hz for `/diagnostics`; it goes on when the simulated time stands still."""
        return self.create_timer(1.0, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _until_shutdown(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(callback)
        def guarded(*args: Any) -> Any:
            try:
                return callback(*args)
            except Exception:
                # After SIGINT publishing fails at any line: that is the shutdown, not a fault.
                if self.context.ok():
                    raise
                return args[-1]  # the response, where a service is cut short

        return guarded

    def configure(self) -> None:
        """Create what the node needs, publishers and subscriptions included."""

    def activate(self) -> None:
        """Start working: timers."""

    def deactivate(self) -> None:
        """Stop what `activate` started."""

    def cleanup(self) -> None:
        """Release what `configure` created."""

    def start(self) -> bool:
        """Configure and activate when `autostart` says so; False when a hook refused."""
        if not self.value("autostart"):
            return True
        return bool(
            self.trigger_configure() == TransitionCallbackReturn.SUCCESS
            and self.trigger_activate() == TransitionCallbackReturn.SUCCESS
        )

    def end(self, exit_code: int = 0) -> None:
        """End the process from a callback."""
        self.exit_code = exit_code
        self.ended.set_result(None)

    def finish(self) -> None:
        """Run the hooks that release resources, whatever state the process ends in."""
        if self._stage == 2:
            self._run("deactivate", self.deactivate, 1)
        if self._stage == 1:
            self._run("cleanup", self.cleanup, 0)

    def on_configure(self, state: Any) -> TransitionCallbackReturn:  # noqa: ARG002
        """Lifecycle transition; the work is in `configure`."""
        return self._run("configure", self.configure, 1)

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Lifecycle transition; managed publishers first, so that `activate` can publish."""
        super().on_activate(state)
        return self._run("activate", self.activate, 2)

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Lifecycle transition; the work is in `deactivate`."""
        result = self._run("deactivate", self.deactivate, 1)
        super().on_deactivate(state)
        return result

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:  # noqa: ARG002
        """Lifecycle transition; the work is in `cleanup`."""
        return self._run("cleanup", self.cleanup, 0)

    def on_error(self, state: Any) -> TransitionCallbackReturn:  # noqa: ARG002
        """Release everything after a hook that failed unexpectedly: the node is unconfigured again."""
        self.finish()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:  # noqa: ARG002
        """Lifecycle transition from any state: release everything."""
        self.finish()
        return TransitionCallbackReturn.SUCCESS

    def _run(self, name: str, hook: Callable[[], None], stage: int) -> TransitionCallbackReturn:
        try:
            hook()
        except (ValueError, OSError) as error:
            self._report(f"{name}: {error}")
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # noqa: BLE001  rclpy would swallow it unseen
            self._report(f"{name}: {type(error).__name__}: {error}")
            return TransitionCallbackReturn.ERROR
        self._stage = stage
        return TransitionCallbackReturn.SUCCESS

    def _report(self, message: str) -> None:
        if self.context.ok():  # else the hook tripped over a shutdown that was asked for
            self.get_logger().error(" ".join(message.split()))
            self.get_logger().debug(traceback.format_exc())

    def _declare(self, parameter: Parameter) -> None:
        try:
            self.declare_parameter(parameter.name, parameter.default, parameter.descriptor())
        except ParameterException as error:
            found = str(error.args[0]).removesuffix(f": {parameter.name}")
            raise ParameterError(f"parameter {parameter.name}: allowed: {parameter.allowed()}; {found}") from error

    def _check(self, candidates: Sequence[Any]) -> SetParametersResult:
        problems = [
            problem
            for candidate in candidates
            if candidate.name in self._declared and (problem := self._declared[candidate.name].problem(candidate.value))
        ]
        return SetParametersResult(successful=not problems, reason="; ".join(problems))


def run_node(factory: Callable[[], ManagedNode], args: Sequence[str] | None = None) -> int:
    """Run a node until it ends or a signal comes, never with a traceback.

    Parameters
    ----------
    factory : callable
        Creates the node, after ROS has been initialised.
    args : sequence of str, optional
        Command line with the program name first; default `sys.argv`.

    Returns
    -------
    int
        Exit code: 0 after SIGINT, SIGTERM or the node's own end, 2 for bad arguments or parameters, 1 for a failure.
    """
    node: ManagedNode | None = None
    try:
        # Before rclpy.init: rclpy's own handler, which ends the context, calls the one it finds.
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, _on_sigint)
        rclpy.init(args=None if args is None else list(args))
        node = factory()
        return _spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        return node.exit_code if node else 0
    except Exception as error:  # noqa: BLE001  the last resort before a traceback
        return _explain(error, node)
    finally:
        _close(node)


def _spin(node: ManagedNode) -> int:
    executor = _executor()
    executor.add_node(node)
    try:
        if not node.start():
            return 2 if node.context.ok() else node.exit_code
        _spinning.set()
        while not node.ended.done() and node.context.ok():
            executor.spin_until_future_complete(node.ended, timeout_sec=WAIT)
    finally:
        _spinning.clear()
        executor.remove_node(node)
        executor.shutdown()
    return node.exit_code


_spinning = threading.Event()


def _on_sigint(number: int, frame: Any) -> None:
    """Break off a start that takes long; while spinning the end of the context is enough.

    The executor would log a `KeyboardInterrupt` in a callback as a fault.
    """
    if not _spinning.is_set():
        signal.default_int_handler(number, frame)


def _executor() -> Any:
    """Events executor where this rclpy has it: half the CPU, no losses at high rates."""
    try:
        from rclpy.experimental import EventsExecutor  # noqa: PLC0415
    except ImportError:
        from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415

        return SingleThreadedExecutor()
    return EventsExecutor()


def _explain(error: Exception, node: ManagedNode | None) -> int:
    """Exit code for an error, with its one line; an error after the context is gone is part of the shutdown."""
    if node is not None and not node.context.ok():
        return node.exit_code
    logger = node.get_logger() if node else get_logger("tbm_monitor")
    message = " ".join(str(error).split())
    if node is None and isinstance(error, ValueError | RuntimeError | ParameterException):
        logger.fatal(message)
        return 2
    logger.fatal(f"{type(error).__name__}: {message}")
    logger.debug(traceback.format_exc())
    return 1


def _close(node: ManagedNode | None) -> None:
    """Release the node's resources; a second signal meanwhile changes nothing."""
    try:
        if node is not None:
            node.finish()
            node.destroy_node()
        rclpy.try_shutdown()
    except KeyboardInterrupt:
        rclpy.try_shutdown()
