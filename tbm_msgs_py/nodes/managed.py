"""Base of every node: a lifecycle node that starts itself, declares its parameters and leaves nothing behind."""

from __future__ import annotations

import copy
import functools
import json
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic

from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import (
    InvalidParameterException,
    InvalidParameterTypeException,
    InvalidParameterValueException,
)
from rclpy.lifecycle import LifecycleNode, State, TransitionCallbackReturn
from rclpy.parameter import Parameter as RosParameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer

from tbm_msgs_py.base.files import write_whole
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.declaring import DeclaredParameters
from tbm_msgs_py.nodes.fault_log import FaultLog
from tbm_msgs_py.nodes.guarding import Guard
from tbm_msgs_py.nodes.logs import PrintableLogger, get_logger
from tbm_msgs_py.nodes.matching import MatchingSubscription
from tbm_msgs_py.nodes.parameters import ParameterError, SettingsT, SummarySettings, parameters_of
from tbm_msgs_py.topics import DIAGNOSTICS, NAMESPACE, contract, status_name

STATUS_PERIOD = 1.0  # s
_SUCCESS = TransitionCallbackReturn.SUCCESS


class ManagedNode(LifecycleNode, Generic[SettingsT]):  # type: ignore[misc]  # rclpy is untyped
    """Lifecycle node whose work is in hooks: `configure`, `activate`, `deactivate`, `cleanup`, `statuses`.

    Publishers, subscriptions, services and timers that `configure` creates go at the clean-up, those of `activate` at
    the deactivation, and either when its hook fails half way. A hook that raises ValueError or OSError fails its
    transition with that line in the log; after any other error the node is unconfigured again. `deactivate` and
    `cleanup` also run when the process ends, the context may be gone by then: they publish nothing.

    The state of a node is on `/diagnostics` once a second. An error that a callback does not expect is reported there
    and in the log, and the node goes on.

    Parameters
    ----------
    name : str
        Default node name.
    settings : type of NodeSettings
        Its fields are the parameters.
    namespace : str
        Default namespace.
    **options
        Of rclpy's `Node`, for a program that holds several nodes: `context`, `cli_args`, `parameter_overrides`.
    """

    _gathered: list[Callable[[], object]] | None = None  # how to destroy what a hook creates, while it runs

    def __init__(self, name: str, settings: type[SettingsT], *, namespace: str = NAMESPACE, **options: Any) -> None:
        self.executable = name
        self._guard = Guard(self)  # rclpy's own services are guarded, too
        self._declared_by = parameters_of(settings)
        super().__init__(name, namespace=namespace, **options)
        self._survive_bad_transitions()
        self.exit_code = 0
        self.ended = Future()
        self._stage = 0  # 0 unconfigured, 1 inactive, 2 active
        self._trouble = ""  # why the last transition went another way than asked
        self._made: dict[int, list[Callable[[], object]]] = {1: [], 2: []}
        self.faults: FaultLog[str] = FaultLog(lambda text: self.get_logger().warning(text))  # shown beside the state
        self._matching: list[MatchingSubscription] = []  # to topics of the contract
        self._clock_seen = 0
        self.clock_stands = False  # at the last look, a second ago at most
        self._declared = DeclaredParameters(
            self, settings, lambda: self._stage > 0, self.check_settings, self.settings_changed
        )
        self._diagnostics = self.contract_publisher(DIAGNOSTICS)
        self.create_steady_timer(STATUS_PERIOD, self.publish_statuses)

    def configure(self) -> None:
        """Create what the node needs, publishers and subscriptions included."""

    def activate(self) -> None:
        """Start working: timers."""

    def deactivate(self) -> None:
        """Stop what `activate` started beyond timers."""

    def cleanup(self) -> None:
        """Release what `configure` created beyond publishers, subscriptions and services."""

    def statuses(self) -> list[DiagnosticStatus]:
        """Return what `/diagnostics` gets once a second while the node is active."""
        return []

    def check_settings(self, settings: SettingsT, names: frozenset[str]) -> None:
        """Raise ValueError if a configured node cannot use these settings; parameters of these names change."""

    def settings_changed(self, names: frozenset[str]) -> None:
        """Use the new values of these parameters of a configured node."""

    @property
    def settings(self) -> SettingsT:
        """The present values of the parameters."""
        return self._declared.settings

    def declare_parameter(self, name: str, *arguments: Any, **options: Any) -> RosParameter:
        """Declare a parameter as rclpy does; a ParameterError names one whose value is not allowed."""
        try:
            return super().declare_parameter(name, *arguments, **options)
        except (InvalidParameterException, InvalidParameterTypeException, InvalidParameterValueException) as error:
            found = str(error.args[0]).removesuffix(f": {name}")
            allowed = f"allowed: {self._declared_by[name].allowed()}; " if name in self._declared_by else ""
            raise ParameterError(f"parameter {name}: {allowed}{found.partition('Reason: ')[2] or found}") from error

    @property
    def active(self) -> bool:
        """Between `activate` and `deactivate`."""
        return self._stage == 2

    @property
    def failed_callbacks(self) -> int:
        """Callbacks that raised unexpected errors, since the start."""
        return self._guard.failed

    def status(
        self,
        task: str,
        level: messages.Level,
        text: str,
        values: messages.Values | None = None,
        hardware: str = "",
    ) -> DiagnosticStatus:
        """Status of one task of this machine; its name starts with the namespace, so that two machines stay apart."""
        return messages.status(self.status_name(task), level, text, values, hardware)

    def status_name(self, task: str) -> str:
        """Name on `/diagnostics` of a task of this machine."""
        return status_name(task, self.get_namespace().strip("/") or self.get_name())

    def get_logger(self) -> PrintableLogger:
        """Logger of the node, which shows control characters in texts of others."""
        return get_logger(super().get_logger().name)

    def contract_publisher(self, topic: str) -> Publisher:
        """Create a publisher of a topic of the contract; parameters may override its quality of service."""
        kind, quality = contract(topic)
        options = qos.overridable()
        return self.create_publisher(
            messages.message_class(kind), topic, qos.profile(quality), qos_overriding_options=options
        )

    def contract_subscription(self, topic: str, callback: Callable[[Any], None], like: str = "") -> None:
        """Subscribe to a topic of the contract, or to one `like` it; parameters may override its quality of service.

        A publisher that offers less is used, too; one of another type is a fault on `/diagnostics`.
        """
        made = MatchingSubscription(
            self, topic, contract(like or topic), callback, self.get_logger().warning, qos.overridable()
        )
        self._matching.append(made)
        self._gather(made, self._leave)

    def _leave(self, subscription: MatchingSubscription) -> None:
        subscription.close()
        self._matching.remove(subscription)

    def create_publisher(self, kind: type, topic: str, profile: QoSProfile, **options: object) -> Publisher:
        """Create a publisher as rclpy does; the profile given stays as it is."""
        # A copy: overrides by parameter are written into the profile.
        made = super().create_publisher(kind, topic, copy.copy(profile), **options)
        return self._gather(made, self.destroy_publisher)

    def create_subscription(
        self, kind: type, topic: str, callback: Callable[..., None], profile: QoSProfile, **options: object
    ) -> Subscription:
        """Subscription as rclpy's, with a guarded callback."""
        made = super().create_subscription(kind, topic, self._guard(callback), copy.copy(profile), **options)
        return self._gather(made, self.destroy_subscription)

    def create_service(
        self, kind: type, name: str, callback: Callable[..., object], *args: object, **kwargs: object
    ) -> Service:
        """Service as rclpy's, with a guarded callback."""
        made = super().create_service(kind, name, self._guard(callback), *args, **kwargs)
        return self._gather(made, self.destroy_service)

    def create_timer(self, period: float, callback: Callable[..., None], *args: object, **kwargs: object) -> Timer:
        """Timer as rclpy's, with a guarded callback."""
        made = super().create_timer(period, self._guard.timer(callback), *args, **kwargs)
        return self._gather(made, self.destroy_timer)

    def create_steady_timer(self, period: float, callback: Callable[..., None]) -> Timer:
        """Timer that goes on when the simulated time stands still."""
        return self.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def write_summary(self, **document: object) -> None:
        """Write a result to the file of the parameter `summary`, if one is named."""
        if isinstance(self.settings, SummarySettings) and self.settings.summary:
            write_whole(Path(self.settings.summary), json.dumps(document).encode())

    def set_parameters(self, parameter_list: list[RosParameter]) -> list[SetParametersResult]:
        """Set parameters one by one, as `set_parameters_atomically` does."""
        return [self.set_parameters_atomically([new]) for new in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[RosParameter]) -> SetParametersResult:
        """Set parameters as rclpy does; one that is fixed now may be set to the value that it has."""
        changed = [new for new in parameter_list if not self._declared.fixed(new)]
        if parameter_list and not changed:
            return SetParametersResult(successful=True)
        return super().set_parameters_atomically(changed)

    def start(self) -> bool:
        """Configure and activate when `autostart` says so; False when a hook refused."""
        if not self.settings.autostart:
            return True
        return bool(self.trigger_configure() == _SUCCESS and self.trigger_activate() == _SUCCESS)

    def end(self, exit_code: int = 0) -> None:
        """End the process from a callback."""
        self.exit_code = exit_code
        self.ended.set_result(None)

    def finish(self) -> None:
        """Run the hooks that release resources, whatever state the process ends in."""
        if self._stage == 2:
            self._go_down("deactivate", self.deactivate, 1)
        if self._stage == 1:
            self._go_down("cleanup", self.cleanup, 0)

    def on_configure(self, state: State) -> TransitionCallbackReturn:  # noqa: ARG002
        """Lifecycle transition; the work is in `configure`."""
        result = self._go_up("configure", self.configure, 1)
        if result == _SUCCESS:
            for name in sorted(self._parameter_overrides):
                if name.startswith(qos.OVERRIDES) and not self.has_parameter(name):
                    self.get_logger().warning(f"{name}: no such topic of this node can be overridden; not used")
        return result

    def on_activate(self, state: State) -> TransitionCallbackReturn:
        """Lifecycle transition; managed publishers first, so that `activate` can publish."""
        super().on_activate(state)
        return self._go_up("activate", self.activate, 2)

    def on_deactivate(self, state: State) -> TransitionCallbackReturn:
        """Lifecycle transition; the work is in `deactivate`."""
        result = self._go_down("deactivate", self.deactivate, 1)
        super().on_deactivate(state)
        return result

    def on_cleanup(self, state: State) -> TransitionCallbackReturn:  # noqa: ARG002
        """Lifecycle transition; the work is in `cleanup`."""
        return self._go_down("cleanup", self.cleanup, 0)

    def on_error(self, state: State) -> TransitionCallbackReturn:  # noqa: ARG002
        """Release everything after a hook that failed unexpectedly: the node is unconfigured again."""
        trouble = self._trouble
        self.finish()
        self._trouble = trouble
        return _SUCCESS

    def on_shutdown(self, state: State) -> TransitionCallbackReturn:  # noqa: ARG002
        """Lifecycle transition from any state: release everything."""
        self.finish()
        return _SUCCESS

    def publish_statuses(self) -> None:
        """Publish the statuses now."""
        now = self.get_clock().now().nanoseconds
        self.clock_stands, self._clock_seen = now == self._clock_seen, now
        statuses = (self._guard(self.statuses)() or []) if self.active else []
        self._diagnostics.publish(messages.diagnostics(now, [*statuses, self._own_status()]))

    def _own_status(self) -> DiagnosticStatus:
        """Whether the node does its work."""
        unexpected = self._guard.show()
        others = [*self.faults.show().values(), *(problem for one in self._matching if (problem := one.problem()))]
        _, state = self._state_machine.current_state
        doing = f"{state} after an error: {self._trouble}" if self._trouble else state
        text = "; ".join([doing, *unexpected, *others])
        level: messages.Level = (
            "error" if self._trouble or unexpected else "ok" if self.active and not others else "warn"
        )
        return self.status(self.get_name(), level, text, {"state": state, "failed_callbacks": self._guard.failed})

    def _go_up(self, name: str, hook: Callable[[], None], stage: int) -> TransitionCallbackReturn:
        self._gathered = self._made[stage]
        result = self._call(name, hook)
        self._gathered = None
        if result == _SUCCESS:
            self._stage = stage
        else:
            self._release(stage)
        return result

    def _go_down(self, name: str, hook: Callable[[], None], stage: int) -> TransitionCallbackReturn:
        result = self._call(name, hook)
        self._release(stage + 1)
        self._stage = stage
        # What is released does not come back: the node is down, whatever went wrong in the hook.
        return _SUCCESS if result == TransitionCallbackReturn.FAILURE else result

    def _call(self, name: str, hook: Callable[[], None]) -> TransitionCallbackReturn:
        self._trouble = ""
        try:
            hook()
        except (ValueError, OSError) as error:
            self._report(f"{name}: {error}")
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # noqa: BLE001  rclpy would swallow it unseen
            self._report(f"{name}: {type(error).__name__}: {error}")
            return TransitionCallbackReturn.ERROR
        return _SUCCESS

    def _report(self, message: str) -> None:
        if self.context.ok():  # else a shutdown that was asked for broke the hook off
            self._trouble = " ".join(message.split())
            self.get_logger().error(self._trouble)
            self.get_logger().debug(traceback.format_exc())

    def _gather(self, made: Any, destroy: Callable[[Any], object]) -> Any:
        if self._gathered is not None:
            self._gathered.append(functools.partial(destroy, made))
        return made

    def _release(self, stage: int) -> None:
        while self._made[stage]:
            self._made[stage].pop()()

    def _survive_bad_transitions(self) -> None:
        """Answer a transition that the state does not have with `success: false`; rclpy would end the process."""
        service = self._service_change_state
        change = service.callback

        def answer(request: ChangeState.Request, response: ChangeState.Response) -> ChangeState.Response:
            try:
                return change(request, response)
            except RuntimeError:  # rcl has logged which one
                response.success = False
                return response

        service.callback = answer
