"""The inputs of a study of any machine: Table 4's ranges as factors on its own values, within its limits."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

from tbm_dynamics import Machine, MachineError
from tbm_dynamics.machine.drive import DriveTemplate
from tbm_dynamics.machine.inputs import STIFFNESS, drive_input, input_values
from tbm_gsa.sensitivity.study.distributions import Uniform
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.inputs import (
    CONNECTION_STIFFNESS,
    LOAD_INPUTS,
    PAPER_INPUTS,
    PAPER_MACHINE,
    Input,
    InputSet,
    known_input,
)
from tbm_msgs_py.base.units import R_MIN

_MOST_POISSON: Final = 0.49
"""No steel, but below what the model allows."""
_ROUNDING: Final = 1.0 - 1e-9
_LENGTHS: Final[Mapping[str, Callable[[DriveTemplate], float]]] = {
    "backlash": lambda drive: drive.mesh.backlash / 300e-6,
    "eccentricity": lambda drive: drive.gear.module / 0.022,
}
"""Size of a machine's teeth over those of the paper's, by what of a single drive is a length."""


def default_inputs(machine: Machine) -> InputSet:
    """Select the inputs that a study of a machine varies if none are named.

    Of the paper's machine Table 4. Of any other those of Table 4 that it has, and the stiffness of its connections that
    have no role there, over the same ranges as factors on its own values: a machine driven within its limits, of a
    material that there is. What is 0 has no such range, and is left out.
    """
    if machine.name == PAPER_MACHINE:
        return PAPER_INPUTS
    own, most = input_values(machine.description), _highest(machine)
    items = [
        _around(known_input(code), value, most.get(code, math.inf))
        for code, value in own.items()
        if code not in (*LOAD_INPUTS.codes, *unvaried_inputs(machine))
    ]
    codes = [item.code for item in items]
    unknown = tuple(code for code in codes if code.startswith(STIFFNESS))
    groups = {name: tuple(code for code in members if code in codes) for name, members in PAPER_INPUTS.groups.items()}
    groups[CONNECTION_STIFFNESS] += unknown
    return InputSet(tuple(items), {name: members for name, members in groups.items() if members})


def unvaried_inputs(machine: Machine) -> tuple[str, ...]:
    """Codes of inputs that `default_inputs` leaves out, for they are 0 and have no range around that."""
    if machine.name == PAPER_MACHINE:
        return ()
    return tuple(code for code, value in input_values(machine.description).items() if value == 0.0)


def check_ends(machine: Machine, ends: Mapping[str, tuple[float, float]]) -> None:
    """Raise a StudyError where a machine allows no such value, before every simulation fails of it.

    Parameters
    ----------
    machine : Machine
    ends : mapping of str to (float, float)
        Lower and upper bound by input.
    """
    for code, bounds in ends.items():
        for value in bounds:
            try:
                machine.with_inputs(**{code: value})
            except MachineError as error:
                raise StudyError(f"input {code} at {value:g}: {error}") from None


def machine_input(machine: Machine, code: str) -> Input:
    """Input of a code, over the range that a study of the machine takes if none is stated.

    Raises
    ------
    StudyError
        Unknown.
    """
    found, known = default_inputs(machine), known_input(code)
    if code in found.codes:
        return found[code]
    _, key = drive_input(code) or (0, "")
    if key not in _LENGTHS or machine.name == PAPER_MACHINE:
        return known
    factor = _LENGTHS[key](machine.description.driveshaft)
    law = Uniform(known.lower * factor, known.upper * factor)
    return replace(known, initial=known.initial * factor, distribution=law)


def _highest(machine: Machine) -> dict[str, float]:
    """Highest values of inputs that a machine allows, all at a time: power limits speed and torque together."""
    point, limits = machine.description.operating_point, machine.description.operating_limits
    most = {"x6": _MOST_POISSON}
    if limits is None:
        return most
    wanted = [PAPER_INPUTS[code].upper / PAPER_INPUTS[code].initial for code in ("x1", "x2")]
    speed, torque = (
        min(value * factor, limit)
        for value, factor, limit in zip(
            (point.speed_r_min, point.torque_kn_m), wanted, (limits.speed_r_min, limits.torque_kn_m), strict=True
        )
    )
    # What power is left is shared by both, in proportion to how far they may go.
    spare = max(0.0, math.log(limits.power_kw / (point.speed_r_min * point.torque_kn_m * R_MIN)))
    asked = math.log(speed * torque / (point.speed_r_min * point.torque_kn_m))
    share = 1.0 if asked <= spare else _ROUNDING * spare / asked
    return most | {
        "x1": point.speed_r_min * (speed / point.speed_r_min) ** share,
        "x2": point.torque_kn_m * (torque / point.torque_kn_m) ** share,
        "x3": limits.thrust_kn,
    }


def _around(item: Input, value: float, most: float) -> Input:
    """Input with the range of Table 4 as factors on a value."""
    low, high = (float(f"{value * bound / item.initial:.4g}") for bound in (item.lower, item.upper))
    return replace(item, initial=value, distribution=Uniform(low, max(value, min(high, most))))
