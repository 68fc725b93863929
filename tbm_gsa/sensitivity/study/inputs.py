"""The uncertain inputs of a study: the paper's Table 4, the same of any machine, and the factors of the loads."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Final, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator

from tbm_dynamics import Machine, MachineError
from tbm_dynamics.machine.drive import DriveTemplate
from tbm_dynamics.machine.inputs import STIFFNESS, drive_input, input_values, multiplied_part
from tbm_gsa.reading import Name
from tbm_gsa.sensitivity.study.distributions import Distribution, LogNormal, Uniform, distribution_from, number
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.texts import LONGEST_LINE, quoted
from tbm_msgs_py.base.units import R_MIN

InputKind = Literal["absolute", "multiplier"]
KINDS: Final[tuple[InputKind, ...]] = ("absolute", "multiplier")
TEXTS: Final = ("code", "name", "symbol", "unit")
_STIFFNESSES: Final = "connection stiffness"
_MOST_POISSON: Final = 0.49
"""No steel, but below what the model allows."""
_ROUNDING: Final = 1.0 - 1e-9
_LENGTHS: Final[Mapping[str, Callable[[DriveTemplate], float]]] = {
    "backlash": lambda drive: drive.mesh.backlash / 300e-6,
    "eccentricity": lambda drive: drive.gear.module / 0.022,
}
"""Size of a machine's teeth over those of the paper's, by what of a single drive is a length."""


@dataclass(frozen=True)
class Input:
    """One uncertain input.

    Parameters
    ----------
    code : str
        Name in the paper's Table 4, ``stiffness.NAME``, ``loads.GROUP`` or ``drive_N.KEY``, as in
        ``Machine.with_inputs``.
    name, symbol, unit : str
        For tables and axes; a multiplier has no unit.
    kind : {"absolute", "multiplier"}
    initial : float
        In `unit`; for a multiplier, a factor on the machine's own value. So are the values of the distribution.
    distribution : Distribution
    """

    code: str
    name: str
    symbol: str
    unit: str
    kind: InputKind
    initial: float
    distribution: Distribution

    def __post_init__(self) -> None:
        if not self.lower <= self.initial <= self.upper:
            raise StudyError(f"input {self.code}: initial {self.initial:g}, allowed: {self.lower:g} to {self.upper:g}")

    @property
    def lower(self) -> float:
        """Lower bound."""
        return self.distribution.lower

    @property
    def upper(self) -> float:
        """Upper bound."""
        return self.distribution.upper

    def to_dict(self) -> dict[str, str | float]:
        """Plain data, for JSON; the parameters of the distribution stand beside the rest."""
        texts = {key: getattr(self, key) for key in (*TEXTS, "kind")}
        return {**texts, "initial": self.initial, **self.distribution.to_dict()}

    @classmethod
    def from_dict(cls, given: object) -> Self:
        """Inverse of `to_dict`."""
        if not isinstance(given, Mapping):
            raise StudyError(f"an input: {quoted(given)}, allowed: a mapping")
        code, name, symbol, unit = (_text(key, given.get(key)) for key in TEXTS)
        kind: InputKind | None = next((kind for kind in KINDS if kind == given.get("kind")), None)
        if kind is None:
            raise StudyError(f"kind of an input: {quoted(given.get('kind'))}, allowed: {', '.join(KINDS)}")
        law = {key: value for key, value in given.items() if key not in {*TEXTS, "kind", "initial"}}
        initial = number("initial", given.get("initial"))
        return cls(code, name, symbol, unit, kind, initial, distribution_from(law))


@dataclass(frozen=True)
class InputSet:
    """Uncertain inputs in a fixed order, the order of every column in this package.

    Parameters
    ----------
    inputs : tuple of Input
        With distinct codes.
    groups : mapping of str to tuple of str
        Codes of the inputs that are ranked as one, by the group's name. No input is in two; one that is in none stands
        for itself.
    """

    inputs: tuple[Annotated[Input, BeforeValidator(Input.from_dict)], ...]
    groups: Mapping[Name, tuple[Name, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.inputs:
            raise StudyError("inputs: none, allowed: at least one")
        for code in self.codes:
            if self.codes.count(code) > 1:
                raise StudyError(f"input {code}: given twice, allowed: once")
        check_groups(self.groups, self.codes)

    def __len__(self) -> int:
        return len(self.inputs)

    def __getitem__(self, code: str) -> Input:
        for item in self.inputs:
            if item.code == code:
                return item
        raise StudyError(f"unknown input {quoted(code)}, allowed: {', '.join(self.codes)}")

    @property
    def codes(self) -> tuple[str, ...]:
        """Codes in order."""
        return tuple(item.code for item in self.inputs)

    @property
    def ends(self) -> dict[str, tuple[float, float]]:
        """Lower and upper bound by code."""
        return {item.code: (item.lower, item.upper) for item in self.inputs}

    def to_unit(self, points: ArrayLike) -> Array:
        """Map points (n, d) to the unit cube, where every input is uniform.

        Raises
        ------
        StudyError
            A value that is missing or outside the range of its input; the message names the first.
        """
        unit = []
        for item, column in zip(self.inputs, self._columns(points).T, strict=True):
            outside = column[~((column >= item.lower) & (column <= item.upper))]
            if outside.size:
                raise StudyError(f"input {item.code}: {outside[0]:g}, allowed: {item.lower:g} to {item.upper:g}")
            unit.append(item.distribution.to_unit(column))
        return np.column_stack(unit)

    def from_unit(self, unit: ArrayLike) -> Array:
        """Map points (n, d) of the unit cube to values; inverse of `to_unit`."""
        columns = self._columns(unit).T
        return np.column_stack(
            [item.distribution.from_unit(column) for item, column in zip(self.inputs, columns, strict=True)]
        )

    def sample(self, row: Sequence[float] | Array) -> dict[str, float]:
        """One point (d,) as the mapping that an evaluation takes."""
        return {code: float(value) for code, value in zip(self.codes, row, strict=True)}

    def _columns(self, points: ArrayLike) -> Array:
        """Points as an array (n, d)."""
        values = np.asarray(points, dtype=np.float64)
        if values.ndim != 2 or values.shape[1] != len(self):
            raise StudyError(f"points of shape {values.shape}, allowed: (n, {len(self)}), one column per input")
        return values


def _text(key: str, given: object) -> str:
    """Return a text of an input; raise a StudyError for anything else."""
    if not isinstance(given, str) or len(given) > LONGEST_LINE:
        raise StudyError(f"{key} of an input: {quoted(given)}, allowed: a text")
    return given


def check_groups(groups: Mapping[str, Sequence[str]], codes: Sequence[str]) -> None:
    """Raise a StudyError unless the groups are disjoint, not empty, of known inputs, and not named like one."""
    seen: dict[str, str] = {}
    for name, members in groups.items():
        if name in codes:
            raise StudyError(f"group {name}: an input has this name, allowed: another one")
        if not members:
            raise StudyError(f"group {name}: no input, allowed: at least one")
        for code in members:
            if code not in codes:
                raise StudyError(f"group {name}: unknown input {quoted(code)}, allowed: {', '.join(codes)}")
            if code in seen:
                raise StudyError(f"group {name}: input {code} is in group {seen[code]} already, allowed: one group")
            seen[code] = name


def _absolute(code: str, name: str, symbol: str, unit: str, initial: float, bounds: tuple[float, float]) -> Input:
    return Input(code, name, symbol, unit, "absolute", initial, Uniform(*bounds))


def _damping(code: str, of: str, symbol: str) -> Input:
    return _absolute(code, f"Damping ratio of {of}", symbol, "", 1e-3, (2e-4, 5e-3))


def _multiplier(code: str, name: str, symbol: str, bounds: tuple[float, float]) -> Input:
    return Input(code, name, symbol, "", "multiplier", 1.0, Uniform(*bounds))


def _stiffness(code: str, of: str, symbol: str) -> Input:
    return _multiplier(code, f"Stiffness of {of}", symbol, (0.5, 2.0))


PAPER_MACHINE: Final = "dz101"
"""Name of the machine that Table 4 is of."""

# Table 4 of the paper, in the units of Machine.with_inputs. The text's k_c,cb (x19) and k_c,bc (x22) are k_c,fb and
# k_b,io of this table. The groups are its first column, whose connection parameters are split in two.
PAPER_INPUTS: Final = InputSet(
    (
        _absolute("x1", "Rotating speed", "ω", "r/min", 5.6, (5.3, 5.9)),
        _absolute("x2", "Torque", "T_in", "kN·m", 2280.0, (1000.0, 2500.0)),
        _absolute("x3", "Thrust", "F_a", "kN", 1.4e4, (1.2e4, 1.5e4)),
        _damping("x4", "steel", "ζ_g"),
        _absolute("x5", "Elasticity modulus", "E", "GPa", 210.0, (200.0, 220.0)),
        _absolute("x6", "Poisson ratio", "λ", "", 0.3, (0.29, 0.31)),
        _absolute("x7", "Backlash", "b_gp", "µm", 300.0, (100.0, 500.0)),
        _multiplier("x8", "Meshing error", "e_gp", (0.8, 1.2)),
        _absolute("x9", "Mean meshing stiffness", "k_gp", "N/m", 8.1e9, (7.5e9, 8.5e9)),
        _absolute("x10", "Damping ratio of gear mesh", "ζ_m", "", 0.05, (0.03, 0.17)),
        _damping("x11", "rock", "ζ_r"),
        _damping("x12", "bolt", "ζ_bt"),
        _damping("x13", "bearing", "ζ_br"),
        _damping("x14", "spline", "ζ_s"),
        _damping("x15", "hydraulic", "ζ_h"),
        _stiffness("x16", "cutterhead–rock", "k_r,ct"),
        _stiffness("x17", "girder–rock", "k_r,gd"),
        _stiffness("x18", "cutterhead–flange", "k_c,cf"),
        _stiffness("x19", "flange–bearing", "k_c,fb"),
        _stiffness("x20", "bearing–carrier", "k_c,bc"),
        _stiffness("x21", "carrier–girder", "k_c,cg"),
        _stiffness("x22", "main bearing", "k_b,io"),
        _stiffness("x23", "pinion–bearing", "k_b,pc"),
        _stiffness("x24", "pinion–gearbox", "k_s,pg"),
        _stiffness("x25", "hydraulic", "k_h,gd"),
    ),
    {
        "external conditions": ("x1", "x2", "x3"),
        "material": ("x4", "x5", "x6"),
        "meshing": ("x7", "x8", "x9", "x10"),
        "connection damping": tuple(f"x{k}" for k in range(11, 16)),
        _STIFFNESSES: tuple(f"x{k}" for k in range(16, 26)),
    },
)


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
    groups[_STIFFNESSES] += unknown
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


LOAD_PRIOR: Final = LogNormal(lower=0.125, upper=8.0, median=1.0, log_sigma=math.log(2.0))
"""Factor of a group of loads: within a factor of two with a probability of 0.68, never beyond three times that."""


def _load(group: str, of: str, symbol: str) -> Input:
    return Input(f"loads.{group}", f"Fluctuation of {of}", symbol, "", "absolute", 1.0, LOAD_PRIOR)


LOAD_INPUTS: Final = InputSet(
    (
        _load("axial_low", "the axial force, lowest region", "f_A,low"),
        _load("axial_high", "the axial force above it", "f_A,high"),
        _load("torsion_low", "the torque, lowest region", "f_T,low"),
        _load("torsion_high", "the torque above it", "f_T,high"),
        _load("lateral", "the lateral forces", "f_L"),
        _load("moments", "the overturning moments", "f_M"),
    )
)

KNOWN_INPUTS: Final = InputSet((*PAPER_INPUTS.inputs, *LOAD_INPUTS.inputs))
"""All that a study can vary of a whole machine."""

_OF_A_DRIVE: Final = InputSet(
    (
        _absolute("backlash", "Backlash", "b", "µm", 300.0, (100.0, 500.0)),
        _multiplier("mesh_error", "Meshing error", "e", (0.5, 4.0)),
        _multiplier("tooth_stiffness", "Meshing stiffness", "k", (0.5, 1.5)),
        _absolute("torque_share", "Weight in the torque", "w", "", 1.0, (0.8, 1.2)),
        _multiplier("seat_stiffness", "Stiffness of the pinion seats", "k_b", (0.5, 2.0)),
        _multiplier("mount_stiffness", "Stiffness of the mount", "k_m", (0.5, 2.0)),
        _absolute("eccentricity", "Eccentricity of the pinion", "ε", "µm", 0.0, (0.0, 200.0)),
        _absolute("misalignment", "Share of the face without contact", "m", "", 0.0, (0.0, 0.5)),
    )
)


def known_input(code: str) -> Input:
    """Input of a code, of the whole machine, a connection by its name or one drive: ``drive_3.backlash``.

    Raises
    ------
    StudyError
        Unknown.
    """
    number, key = drive_input(code) or (0, "")
    if key in _OF_A_DRIVE.codes:
        item = _OF_A_DRIVE[key]
        return replace(item, code=code, name=f"{item.name}, drive {number}", symbol=f"{item.symbol},{number}")
    if code in KNOWN_INPUTS.codes:
        return KNOWN_INPUTS[code]
    of_a_drive = ", ".join(f"drive_N.{key}" for key in _OF_A_DRIVE.codes)
    if name := multiplied_part(code):
        return _stiffness(code, name, name)
    raise StudyError(
        f"unknown input {quoted(code)}, allowed: {', '.join(KNOWN_INPUTS.codes)}, {of_a_drive}, and of a connection "
        f"{STIFFNESS}NAME"
    )
