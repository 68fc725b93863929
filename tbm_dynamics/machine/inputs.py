"""The 25 uncertain inputs of the paper's Table 4, applied to a machine description.

Values are in Table 4's units: x1 r/min, x2 kN·m, x3 kN, x5 GPa, x7 µm, x9 N/m; x8 and x16 … x25 are multipliers;
the damping ratios x4 and x11 … x15 are Table 4's numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from numbers import Real
from typing import Any

from tbm_dynamics.machine.description import MachineDescription
from tbm_msgs_py.base.errors import MachineError
from tbm_msgs_py.base.validation import validated

# (path in the description, factor from Table 4's unit to the file's)
_VALUES: dict[str, tuple[str, float]] = {
    "x1": ("operating_point.speed_r_min", 1.0),
    "x2": ("operating_point.torque_kn_m", 1.0),
    "x3": ("operating_point.thrust_kn", 1.0),
    "x4": ("steel.damping", 1.0),
    "x5": ("steel.elasticity", 1e9),
    "x6": ("steel.poisson", 1.0),
    "x7": ("driveshaft.mesh.backlash", 1e-6),
    "x8": ("driveshaft.mesh.error_factor", 1.0),
    "x9": ("driveshaft.mesh.mean_stiffness", 1.0),
    "x10": ("driveshaft.mesh.damping_ratio", 1.0),
    "x11": ("connection_damping.rock", 1.0),
    "x12": ("connection_damping.bolt", 1.0),
    "x13": ("connection_damping.bearing", 1.0),
    "x14": ("connection_damping.spline", 1.0),
    "x15": ("connection_damping.hydraulic", 1.0),
}

# Connections, by name, whose six stiffnesses a multiplier scales. The names are Table 5's;
# Table 4 swaps the labels of x20 and x22 in the text.
_MULTIPLIED: dict[str, str] = {
    "x16": "k_r_ct",
    "x17": "k_r_gd",
    "x18": "k_c_cf",
    "x19": "k_c_fb",
    "x20": "k_c_bc",
    "x21": "k_c_cg",
    "x22": "k_b_io",
    "x23": "driveshaft.pinion_bearing.stiffness",
    "x24": "driveshaft.spline.stiffness",
    "x25": "k_h_gd",
}

INPUT_CODES: tuple[str, ...] = (*_VALUES, *_MULTIPLIED)


def apply_inputs(base: MachineDescription, inputs: Mapping[str, float]) -> MachineDescription:
    """Return `base` with the named inputs changed and nothing else.

    Raises
    ------
    MachineError
        Unknown input, or a value outside what the description allows.
    """
    data = base.model_dump()
    for code, value in inputs.items():
        if code not in INPUT_CODES:
            raise MachineError(f"input {code!r}: unknown; allowed are x1 … x25")
        number = _number(code, value)
        if code in _VALUES:
            path, factor = _VALUES[code]
            _edit(data, path, partial(_replaced, number * factor))
        else:
            _multiply(data, code, number)
    return validated(MachineDescription, data, f"inputs {dict(inputs)}", MachineError)


def _number(code: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise MachineError(f"input {code}: must be a number, got {value!r}")
    number = float(value)
    if code in _MULTIPLIED and number <= 0.0:
        raise MachineError(f"input {code}: a stiffness multiplier must be positive, got {number}")
    return number


def _edit(data: dict[str, Any], path: str, change: Callable[[Any], Any]) -> None:
    *parents, last = path.split(".")
    for key in parents:
        data = data[key]
    data[last] = change(data[last])


def _replaced(new: float, _: object) -> float:
    return new


def _multiply(data: dict[str, Any], code: str, factor: float) -> None:
    def scaled(stiffness: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(factor * k for k in stiffness)

    target = _MULTIPLIED[code]
    if target.startswith("driveshaft."):
        _edit(data, target, scaled)
        return
    # Table 5's values are per connection element: every connection of that name follows.
    groups = (data["cutterhead_bearing_gear"], data["carrier_girder"], data)
    followers = [found for group in groups for found in group["connections"] if found["name"] == target]
    if not followers:
        raise MachineError(f"input {code}: machine {data['name']} has no connection named {target}")
    for connection in followers:
        connection["stiffness"] = scaled(connection["stiffness"])


def input_values(description: MachineDescription) -> dict[str, float]:
    """Values of the inputs that a machine has, in Table 4's units; a multiplier is that over the machine as it stands.

    Returns
    -------
    dict of str to float
        Without the connections that its file does not name.
    """
    data = description.model_dump()
    found = {code: _value(data, path) / factor for code, (path, factor) in _VALUES.items()}
    names = {connection.name for connection in description.all_connections()}
    return found | {code: 1.0 for code, target in _MULTIPLIED.items() if "." in target or target in names}


def _value(data: Any, path: str) -> float:
    for key in path.split("."):
        data = data[key]
    return float(data)
