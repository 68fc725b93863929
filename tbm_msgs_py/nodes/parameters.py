"""ROS parameters are the fields of a node's settings: type, range, text and default stand in that model alone.

A group of parameters is a model of its own. Nothing here needs ROS: the documentation and the reader of parameter files
ask for the same declarations as the nodes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib import import_module
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.fields import FrozenModel
from tbm_msgs_py.base.texts import LONGEST_NAME, doubled, shortened
from tbm_msgs_py.nodes.registry import NODES

_KINDS = {bool: "true or false", int: "a whole number", float: "a decimal number", str: "text", list: "a list"}
DATA_ROOT = "data_root"
ParameterValue = bool | int | float | str | list[str] | list[float]
Changes = Literal["start", "unconfigured", "running"]
SettingsT = TypeVar("SettingsT", bound="NodeSettings")


class ParameterError(InputError):
    """A parameter given a value that is not allowed, in one line."""


class _Handling(FrozenModel):
    """What ROS makes of a parameter, as in `parameter`."""

    changes: Changes = "unconfigured"
    written: bool = False
    no_path: tuple[str, ...] = ("",)


def parameter(  # as pydantic's Field: any default, for a field of its type
    default: Any,
    text: str,
    *,
    low: float | None = None,
    high: float | None = None,
    changes: Changes = "unconfigured",
    written: bool = False,
    no_path: tuple[str, ...] = ("",),
) -> Any:
    """Field of a node's settings.

    Parameters
    ----------
    default : bool, int, float, str or tuple
    text : str
        One line for the user, with the unit.
    low, high : float, optional
        Allowed range of a number, ends included.
    changes : "start", "unconfigured" or "running"
        When another value is accepted: at the start only (read-only), between `cleanup` and `configure`, or always.
    written : bool
        It is a path at which the node makes files: after the start only one below the data root is accepted.
    no_path : tuple of str
        Values of such a parameter that are no path.
    """
    handling = _Handling(changes=changes, written=written, no_path=no_path).model_dump(mode="json")
    return Field(default, description=text, ge=low, le=high, json_schema_extra=handling)


live_parameter = partial(parameter, changes="running")


def each_once(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names, if each stands once; raises ValueError for others."""
    if twice := doubled(names):
        raise ValueError(f"{twice} twice, allowed: each once")
    return names


Names = Annotated[tuple[str, ...], AfterValidator(each_once)]


class NodeSettings(FrozenModel):
    """Parameters of a node, validated and frozen."""

    model_config = ConfigDict(allow_inf_nan=False)

    autostart: bool = parameter(
        True, "configure and activate at the start, without a lifecycle manager", changes="start"
    )


class MachineSettings(NodeSettings):
    """Of a node of a machine."""

    machine: str = parameter("dz101", "machine: name of a shipped one, or path of a machine file")


class SummarySettings(NodeSettings):
    """Of a node that comes to an end."""

    summary: str = parameter("", "file that gets the result as JSON at the end; empty for none", changes="start")


class WritingSettings(NodeSettings):
    """Of a node that makes files where parameters say."""

    data_root: str = parameter(
        "",
        "folder below which paths written to may be set while the node runs; empty: tbm_monitor in the user's data "
        "folder",
        changes="start",
    )


@dataclass(frozen=True)
class Parameter:
    """Declaration of one ROS parameter, as its field has it; its type is that of the default.

    Attributes
    ----------
    name : str
        Name, dots for groups.
    default : bool, int, float, str or list
        Default. An empty list of strings is ``[""]``: ROS cannot type an empty one. A list of floats keeps its length.
    description : str
        One line for the user, with the unit.
    minimum, maximum : float
        Allowed range of a number, or of every number of a list, ends included.
    choices : tuple of str
        Allowed values of a string.
    changes, written, no_path
        As in `parameter`.
    """

    name: str
    default: ParameterValue
    description: str
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()
    changes: Changes = "unconfigured"
    written: bool = False
    no_path: tuple[str, ...] = ("",)

    @property
    def live(self) -> bool:
        """Whether it may change at run time."""
        return self.changes == "running"

    def allowed(self) -> str:
        """Type and range in words."""
        if self.choices:
            return f"one {'or more ' * isinstance(self.default, list)}of {', '.join(self.choices)}"
        if isinstance(self.default, list) and isinstance(self.default[0], float):
            return f"{len(self.default)} decimal numbers{self.limits}"
        return f"{_KINDS[type(self.default)]}{self.limits}"

    @property
    def limits(self) -> str:
        """Limits in words; empty where there are none."""
        known = math.isfinite(self.minimum) or math.isfinite(self.maximum)
        return f" from {self.minimum:.10g} to {self.maximum:.10g}" if known else ""


@lru_cache
def parameters_of(settings: type[BaseModel], group: str = "") -> Mapping[str, Parameter]:
    """Parameters that settings declare, by name."""
    declared: dict[str, Parameter] = {}
    for name, field in settings.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            declared |= parameters_of(kind, f"{group}{name}.")
        else:
            declared[group + name] = _declaration(group + name, field)
    return declared


def node_parameters(node: str) -> Mapping[str, Parameter]:
    """Parameters of a registered node, by name."""
    module, _, name = NODES[node].settings.rpartition(".")
    return parameters_of(getattr(import_module(module), name))


def _declaration(name: str, field: FieldInfo) -> Parameter:
    kind, default = field.annotation, field.default
    bounds = list(field.metadata)
    if isinstance(default, tuple):  # its elements have the range or the choices
        kind, default = get_args(kind)[0], list(default) or [""]
        bounds += [one for mark in getattr(kind, "__metadata__", ()) for one in getattr(mark, "metadata", [mark])]
    handling = _Handling.model_validate(field.json_schema_extra or {})
    return Parameter(
        name,
        default,
        field.description or "",
        minimum=next((one.ge for one in bounds if getattr(one, "ge", None) is not None), -math.inf),
        maximum=next((one.le for one in bounds if getattr(one, "le", None) is not None), math.inf),
        choices=get_args(kind) if get_origin(kind) is Literal else (),
        **dict(handling),
    )


def read_settings(settings: type[SettingsT], values: Mapping[str, ParameterValue]) -> SettingsT:
    """Return the settings of the values of parameters by name, as ROS has them.

    Raises
    ------
    ParameterError
        What of them is wrong first, in one line: a value, or that two do not go together.
    """
    nested: dict[str, object] = {}
    for name, value in values.items():
        *groups, last = name.split(".")
        place = nested
        for group in groups:
            inner = place.setdefault(group, {})
            assert isinstance(inner, dict)  # noqa: S101 - no parameter has the name of a group
            place = inner
        place[last] = value if isinstance(value, bool | int | float | str) else [one for one in value if one != ""]
    try:
        return settings.model_validate(nested)
    except ValidationError as error:
        raise ParameterError(_first_problem(error, settings, values)) from None


def _first_problem(error: ValidationError, settings: type[BaseModel], values: Mapping[str, ParameterValue]) -> str:
    first = error.errors(include_url=False)[0]
    name = ".".join(part for part in first["loc"] if isinstance(part, str))
    message = first["msg"].removeprefix("Value error, ")
    declared = parameters_of(settings)
    if name in declared and first["type"] != "value_error":
        return f"parameter {name}: {_text(values[name])}, allowed: {declared[name].allowed()}"
    return f"parameter {name}: {message}" if name else message  # of several, the message names one


def _text(value: ParameterValue) -> str:
    return shortened(str(value) if isinstance(value, bool | int | float | str) else str(list(value)), LONGEST_NAME)
