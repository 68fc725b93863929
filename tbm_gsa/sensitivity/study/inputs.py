"""The uncertain inputs of a study: the paper's Table 4, the factors of the loads, and those of single drives."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Final, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator

from tbm_dynamics.machine.inputs import STIFFNESS, drive_input, multiplied_part
from tbm_gsa.reading import Name
from tbm_gsa.sensitivity.study.distributions import Distribution, LogNormal, Uniform, distribution_from, number
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.texts import LONGEST_LINE, quoted

InputKind = Literal["absolute", "multiplier"]
KINDS: Final[tuple[InputKind, ...]] = ("absolute", "multiplier")
TEXTS: Final = ("code", "name", "symbol", "unit")
CONNECTION_STIFFNESS: Final = "connection stiffness"
"""Group of the stiffnesses of the connections."""


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
        CONNECTION_STIFFNESS: tuple(f"x{k}" for k in range(16, 26)),
    },
)


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
