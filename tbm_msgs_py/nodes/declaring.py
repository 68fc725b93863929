"""The parameters of a node in ROS: declared from its settings, checked by them, read back as them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Generic

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.parameter import Parameter as RosParameter

from tbm_msgs_py.base.files import data_folder
from tbm_msgs_py.nodes import qos
from tbm_msgs_py.nodes.confining import check_below
from tbm_msgs_py.nodes.parameters import DATA_ROOT, Parameter, ParameterValue, SettingsT, parameters_of, read_settings

if TYPE_CHECKING:
    from tbm_msgs_py.nodes.managed import ManagedNode

_WHEN = {
    "start": "set at the start only",
    "unconfigured": "set while the node is unconfigured",
    "running": "may change at run time",
}


class DeclaredParameters(Generic[SettingsT]):
    """Declares the parameters of a node.

    Parameters
    ----------
    node : ManagedNode
    settings : type
    configured : callable
        Whether the node is.
    check : callable
        Called with settings and the names that change, while the node is configured; raises ValueError to refuse them.
    changed : callable
        Called with the names that have changed, while the node is configured.

    Attributes
    ----------
    settings : NodeSettings
        The present ones.

    Raises
    ------
    ParameterError
        A value that the start gives and that is not allowed.
    """

    def __init__(
        self,
        node: ManagedNode[SettingsT],
        settings: type[SettingsT],
        configured: Callable[[], bool],
        check: Callable[[SettingsT, frozenset[str]], None],
        changed: Callable[[frozenset[str]], None],
    ) -> None:
        self._node, self._model, self._configured = node, settings, configured
        self._check_settings, self._changed = check, changed
        self._declared = parameters_of(settings)
        self._stated: dict[str, ParameterValue] = {}  # values that the start gave
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._after_set)
        for one in self._declared.values():
            node.declare_parameter(one.name, one.default, _descriptor(one))
        self._stated = self._values()
        self.settings = read_settings(settings, self._stated)

    def fixed(self, new: RosParameter) -> bool:
        """Whether a parameter accepts its present value only, and this is it."""
        if new.name in self._declared:
            fixed = self._declared[new.name].changes == "start" or (self._configured() and not self._live(new.name))
        else:  # rclpy's own
            fixed = self._node.has_parameter(new.name) and self._node.describe_parameter(new.name).read_only
        if not fixed:
            return False
        present = self._node.get_parameter(new.name)
        return bool(present.type_ == new.type_ and present.get_parameter_value() == new.get_parameter_value())

    def _live(self, name: str) -> bool:
        return self._declared[name].live

    def _values(self) -> dict[str, ParameterValue]:
        return {name: self._node.get_parameter(name).value for name in self._declared}

    def _check(self, candidates: Sequence[RosParameter]) -> SetParametersResult:
        known = {new.name: new.value for new in candidates if new.name in self._declared}
        problems = [text for new in candidates if (text := qos.override_problem(new.name, new.value))]
        if known and self._stated and not problems:
            problems = self._problems(known)
        return SetParametersResult(successful=not problems, reason="; ".join(problems))

    def _problems(self, known: Mapping[str, ParameterValue]) -> list[str]:
        try:
            settings = read_settings(self._model, {**self._values(), **known})
            for name, value in known.items():
                self._check_path(self._declared[name], value)
            if self._configured():
                if fixed := [name for name in known if not self._live(name)]:
                    text = "fixed while the node is configured; clean up, set, configure"
                    return [f"parameter {name}: {text}" for name in fixed]
                self._check_settings(settings, frozenset(known))
        except (ValueError, RuntimeError) as error:
            return [str(error)]
        return []

    def _check_path(self, one: Parameter, value: ParameterValue) -> None:
        """Refuse a path to write to that is set after the start and leads elsewhere."""
        if one.written and value not in one.no_path:
            stated = str(self._stated[one.name])
            root = str(self._stated.get(DATA_ROOT) or data_folder())
            check_below(one.name, str(value), [root, "" if stated in one.no_path else stated])

    def _after_set(self, changed: Sequence[RosParameter]) -> None:
        names = frozenset(new.name for new in changed if new.name in self._declared)
        if names and self._stated:
            self.settings = read_settings(self._model, self._values())
            if self._configured():
                self._changed(names)


def _descriptor(one: Parameter) -> ParameterDescriptor:
    """Descriptor with range, description and read-only flag."""
    constraints = [f"one of: {', '.join(one.choices)}"] if one.choices else []
    described = ParameterDescriptor(
        description=one.description,
        read_only=one.changes == "start",
        additional_constraints="; ".join([*constraints, _WHEN[one.changes]]),
    )
    if isinstance(one.default, list) or not one.limits:
        return described
    if isinstance(one.default, int):
        low, high = max(one.minimum, -(2**63)), min(one.maximum, 2**63 - 1)
        described.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=0)]
    else:
        low, high = float(one.minimum), float(one.maximum)
        described.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
    return described
