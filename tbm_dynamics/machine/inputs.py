"""The 25 uncertain inputs of the paper's Table 4, other stiffnesses, the factors of the loads, what single drives have.

Values are in Table 4's units: x1 r/min, x2 kN·m, x3 kN, x5 GPa, x7 µm, x9 N/m; x8 and x16 … x25 are multipliers;
the damping ratios x4 and x11 … x15 are Table 4's numbers; ``stiffness.NAME`` is the multiplier of the connections of a
name that have no role in Table 5; ``loads.axial_low`` … ``loads.moments`` are the factors;
``drive_3.backlash`` … are the keys of ``drives: {3: …}``, backlash and eccentricity in µm, the others as in the file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from numbers import Real
from operator import attrgetter
from typing import Any, Final

from tbm_dynamics.loads.description import LOAD_GROUPS
from tbm_dynamics.machine.description import MachineDescription
from tbm_dynamics.machine.drive import DriveOverride
from tbm_dynamics.machine.springs import Springs
from tbm_msgs_py.base.errors import MachineError
from tbm_msgs_py.base.validation import validated

Place = tuple[str | int, ...]
"""Keys and indices that lead to a value of a machine file."""

# (place in the description, factor from Table 4's unit to the file's)
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

# Connections whose six stiffnesses a multiplier scales: those of that role, or one of the drives. The roles are
# Table 5's names; Table 4 swaps the labels of x20 and x22 in the text.
_MULTIPLIED: dict[str, str] = {
    "x16": "k_r_ct",
    "x17": "k_r_gd",
    "x18": "k_c_cf",
    "x19": "k_c_fb",
    "x20": "k_c_bc",
    "x21": "k_c_cg",
    "x22": "k_b_io",
    "x23": "driveshaft.pinion_bearing",
    "x24": "driveshaft.spline",
    "x25": "k_h_gd",
}

_DAMPED: Final = "connection_damping."
_OF_DRIVES: Final = ("driveshaft.pinion_bearing", "driveshaft.spline")

INPUT_CODES: tuple[str, ...] = (*_VALUES, *_MULTIPLIED)

STIFFNESS: Final = "stiffness."
"""What the code of the multiplier of a connection by its name begins with."""

LOAD_INPUTS: Final = {f"loads.{group}": f"loads.factors.{group}" for group in LOAD_GROUPS}
"""Factors of the loads by the code of the input."""

DRIVE_INPUTS: Final = {
    "angle": 1.0,
    "backlash": 1e-6,
    "mesh_error": 1.0,
    "tooth_stiffness": 1.0,
    "torque_share": 1.0,
    "seat_stiffness": 1.0,
    "mount_stiffness": 1.0,
    "eccentricity": 1e-6,
    "misalignment": 1.0,
}
"""What of a single drive is an input, ``drive_3.backlash``, and the factor from its unit to the file's."""
_DRIVE: Final = re.compile(r"drive_([1-9][0-9]?)\.([a-z_]+)")

_PLACES: Final = _VALUES | {code: (path, 1.0) for code, path in LOAD_INPUTS.items()}


def apply_inputs(base: MachineDescription, inputs: Mapping[str, float]) -> MachineDescription:
    """Return `base` with the named inputs changed and nothing else.

    Raises
    ------
    MachineError
        Unknown input, or a value outside what the description allows.
    """
    data = base.model_dump(mode="json")
    set_values(data, changed_values(base, inputs))
    return validated(MachineDescription, data, f"inputs {dict(inputs)}", MachineError)


def changed_values(base: MachineDescription, inputs: Mapping[str, float]) -> dict[Place, float]:
    """Values of a machine file that inputs change, in the units of the file.

    Raises
    ------
    MachineError
        Unknown input, no number, or a connection that the machine does not have.
    """
    found: dict[Place, float] = {}
    changes: dict[Place, tuple[float, float]]
    for code, value in inputs.items():
        drive, target = drive_input(code), multiplied_part(code)
        if code not in _PLACES and target is None and not drive:
            raise MachineError(
                f"input {code!r}: unknown; allowed are x1 … x25 and {', '.join(LOAD_INPUTS)}, of a connection "
                f"{STIFFNESS}NAME, and of drive N {', '.join(f'drive_N.{key}' for key in DRIVE_INPUTS)}"
            )
        number = _number(code, value)
        if drive:
            changes = {("drives", *drive): (_of_drive(base, *drive), number * DRIVE_INPUTS[drive[1]])}
        elif code in _PLACES:
            path, factor = _PLACES[code]
            changes = {(*path.split("."),): (attrgetter(path)(base), number * factor)}
        else:
            assert target is not None  # noqa: S101 - else it was refused above
            multiplied = list(_stiffnesses(base, target))
            if not multiplied:
                known = ", ".join(dict.fromkeys(one.part for one in base.all_connections()))
                raise MachineError(
                    f"input {code}: machine {base.name} has no connection named {target}; it has {known}"
                )
            changes = {(*place, i): (k, number * k) for place, six in multiplied for i, k in enumerate(six)}
        found |= {place: after for place, (before, after) in changes.items() if after != before}
    return found


def drive_input(code: str) -> tuple[int, str] | None:
    """Return number and key of an input of a single drive; None of any other text."""
    match = _DRIVE.fullmatch(code)
    return (int(match[1]), match[2]) if match and match[2] in DRIVE_INPUTS else None


def multiplied_part(code: str) -> str | None:
    """Return the role or name of the connections whose stiffness an input scales; None of any other input."""
    named = code.removeprefix(STIFFNESS)
    return _MULTIPLIED.get(code, named if named and named != code else None)


def _of_drive(base: MachineDescription, number: int, key: str) -> float:
    """Value of a key of a drive, nan of one that has none of its own."""
    own = getattr(base.drives.get(number, DriveOverride()), key)
    return math.nan if own is None else float(own)


def _number(code: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise MachineError(f"input {code}: must be a number, got {value!r}")
    number = float(value)
    if multiplied_part(code) is not None and number <= 0.0:
        raise MachineError(f"input {code}: a stiffness multiplier must be positive, got {number}")
    return number


def _stiffnesses(base: MachineDescription, target: str) -> Iterator[tuple[Place, tuple[float, ...]]]:
    """Stiffnesses of a connection of the drives, or of every one of a role or name: Table 5's are per element."""
    found: list[tuple[Place, Springs]] = []
    if target in _OF_DRIVES:
        found.append(((*target.split("."),), attrgetter(target)(base)))
    for group in ("cutterhead_bearing_gear.connections", "carrier_girder.connections", "connections"):
        found += [((*group.split("."), i), c) for i, c in enumerate(attrgetter(group)(base)) if c.part == target]
    for place, springs in found:
        yield (*place, "stiffness"), springs.stiffness
        for i, row in enumerate(springs.stiffness_matrix or ()):
            yield (*place, "stiffness_matrix", i), row


def set_values(data: Any, values: Mapping[Place, float | str], source: str | None = None) -> None:
    """Set values in the data of a machine file; a `source` becomes that of every entry whose number changes.

    A section that the file leaves out is added.
    """
    for (*parents, key), value in values.items():
        around = [data]
        for parent in parents:
            inside, at = around[-1], parent
            if isinstance(inside, dict) and parent not in inside:
                at = str(parent) if str(parent) in inside else parent  # JSON has numbers of drives as texts
                inside.setdefault(at, {})
            around.append(inside[at])
        around[-1][key] = value
        if source is not None and not isinstance(value, str):
            entries = [one for one in reversed(around) if isinstance(one, dict)]
            # Without one, it is an entry that need not say where it is from.
            next((one for one in entries if "source" in one), entries[0])["source"] = source


def input_values(description: MachineDescription) -> dict[str, float]:
    """Values of the inputs that a machine has, in Table 4's units; a multiplier is that over the machine as it stands.

    Returns
    -------
    dict of str to float
        Without roles and types of connection that its file does not have.
    """
    connections, drive = description.all_connections(), description.driveshaft
    types = {drive.pinion_bearing.type, drive.spline.type, *(one.type for one in connections)}
    found = {
        code: float(attrgetter(path)(description)) / factor
        for code, (path, factor) in _PLACES.items()
        if not path.startswith(_DAMPED) or path.removeprefix(_DAMPED) in types
    }
    found |= {code: 1.0 for code, target in _MULTIPLIED.items() if any(_stiffnesses(description, target))}
    return found | {f"{STIFFNESS}{one.part}": 1.0 for one in connections if one.part not in _MULTIPLIED.values()}
