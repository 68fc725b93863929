"""The uncertain inputs of a study: the paper's Table 4, or a set of the user's own."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, Literal, Self

import numpy as np
import yaml

from tbm_gsa.arrays import Array
from tbm_gsa.study.errors import StudyError

Kind = Literal["absolute", "multiplier"]
YAML_KEYS: Final = ("lower", "upper", "initial")


@dataclass(frozen=True)
class Input:
    """One uncertain input, uniform between its bounds.

    Parameters
    ----------
    code : str
        Name in the paper's Table 4 and in ``Machine.with_inputs``.
    name, symbol, unit : str
        For tables and axes; a multiplier has no unit.
    initial, lower, upper : float
        In `unit`; for a multiplier, factors on the machine's own value.
    kind : {"absolute", "multiplier"}
    """

    code: str
    name: str
    symbol: str
    unit: str
    initial: float
    lower: float
    upper: float
    kind: Kind

    def __post_init__(self) -> None:
        values = (self.lower, self.initial, self.upper)
        if not all(np.isfinite(values)):
            raise StudyError(f"input {self.code}: lower, initial and upper must be finite, got {values}")
        if self.lower >= self.upper:
            raise StudyError(f"input {self.code}: lower {self.lower:g} must be below upper {self.upper:g}")
        if not self.lower <= self.initial <= self.upper:
            raise StudyError(
                f"input {self.code}: initial {self.initial:g} must lie in [{self.lower:g}, {self.upper:g}]"
            )


@dataclass(frozen=True)
class InputSet:
    """Uncertain inputs in a fixed order, the order of every column in this package.

    Parameters
    ----------
    inputs : tuple of Input
        With distinct codes.
    """

    inputs: tuple[Input, ...]

    def __post_init__(self) -> None:
        if not self.inputs:
            raise StudyError("a study needs at least one input")
        for code in self.codes:
            if self.codes.count(code) > 1:
                raise StudyError(f"input {code} is given twice")

    def __len__(self) -> int:
        return len(self.inputs)

    def __getitem__(self, code: str) -> Input:
        for item in self.inputs:
            if item.code == code:
                return item
        raise StudyError(f"unknown input {code!r}; available: {', '.join(self.codes)}")

    @property
    def codes(self) -> tuple[str, ...]:
        """Codes in order."""
        return tuple(item.code for item in self.inputs)

    @property
    def bounds(self) -> Array:
        """Lower and upper bounds, (d, 2)."""
        return np.array([[item.lower, item.upper] for item in self.inputs])

    def sample(self, row: Sequence[float] | Array) -> dict[str, float]:
        """One point (d,) as the mapping that an evaluation takes."""
        return {code: float(value) for code, value in zip(self.codes, row, strict=True)}

    def to_list(self) -> list[dict[str, object]]:
        """Plain data, for JSON."""
        return [asdict(item) for item in self.inputs]

    @classmethod
    def from_list(cls, rows: Sequence[Mapping[str, object]]) -> Self:
        """Inverse of `to_list`."""
        return cls(tuple(Input(**row) for row in rows))  # type: ignore[arg-type]

    @classmethod
    def from_yaml(cls, path: str | Path) -> Self:
        """Read a set from a file.

        The file maps codes of Table 4 to ranges; everything else about an input is known by its code. An initial
        value that is not given is the paper's if it lies inside the range, else the middle::

            inputs:
              x2: {lower: 1500, upper: 2000}
              x16: {lower: 0.8, upper: 1.25, initial: 1.0}

        Parameters
        ----------
        path : str or Path

        Raises
        ------
        StudyError
            One line that names the file, the input and what is allowed.
        """
        try:
            document = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise StudyError(f"{path}: cannot be read ({error.strerror})") from None
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise StudyError(f"{path}: not YAML ({' '.join(str(error).split())})") from None
        try:
            return cls(_inputs_from(document))
        except StudyError as error:
            raise StudyError(f"{path}: {error}") from None


def _inputs_from(document: object) -> tuple[Input, ...]:
    """Build the inputs of a parsed file."""
    if not isinstance(document, dict) or set(document) != {"inputs"} or not isinstance(document["inputs"], dict):
        raise StudyError("expected one key, 'inputs', with a mapping of codes to ranges")
    return tuple(_ranged(str(code), given) for code, given in document["inputs"].items())


def _ranged(code: str, given: object) -> Input:
    """Take an input of Table 4 with another range."""
    known = PAPER_INPUTS[code]
    if not isinstance(given, dict) or not {"lower", "upper"} <= set(given) <= set(YAML_KEYS):
        raise StudyError(f"input {code}: expected the keys lower, upper and optionally initial, got {given!r}")
    for key, value in given.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise StudyError(f"input {code}: {key} must be a number, got {value!r}")
    lower, upper = float(given["lower"]), float(given["upper"])
    inside = lower <= known.initial <= upper
    initial = float(given.get("initial", known.initial if inside else 0.5 * (lower + upper)))
    return Input(code, known.name, known.symbol, known.unit, initial, lower, upper, known.kind)


def _damping(code: str, of: str, symbol: str) -> Input:
    return Input(code, f"Damping ratio of {of}", symbol, "", 1e-3, 2e-4, 5e-3, "absolute")


def _stiffness(code: str, of: str, symbol: str) -> Input:
    return Input(code, f"Stiffness of {of}", symbol, "", 1.0, 0.5, 2.0, "multiplier")


# Table 4 of the paper, in the units of Machine.with_inputs. The text's k_c,cb (x19) and k_c,bc (x22) are k_c,fb and
# k_b,io of this table.
PAPER_INPUTS: Final = InputSet(
    (
        Input("x1", "Rotating speed", "ω", "r/min", 5.6, 5.3, 5.9, "absolute"),
        Input("x2", "Torque", "T_in", "kN·m", 2280.0, 1000.0, 2500.0, "absolute"),
        Input("x3", "Thrust", "F_a", "kN", 1.4e4, 1.2e4, 1.5e4, "absolute"),
        _damping("x4", "steel", "ζ_g"),
        Input("x5", "Elasticity modulus", "E", "GPa", 210.0, 200.0, 220.0, "absolute"),
        Input("x6", "Poisson ratio", "λ", "", 0.3, 0.29, 0.31, "absolute"),
        Input("x7", "Backlash", "b_gp", "µm", 300.0, 100.0, 500.0, "absolute"),
        Input("x8", "Meshing error", "e_gp", "", 1.0, 0.8, 1.2, "multiplier"),
        Input("x9", "Mean meshing stiffness", "k_gp", "N/m", 8.1e9, 7.5e9, 8.5e9, "absolute"),
        Input("x10", "Damping ratio of gear mesh", "ζ_m", "", 0.05, 0.03, 0.17, "absolute"),
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
    )
)
