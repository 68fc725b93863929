"""What rows of a history this program writes, as conditions in SQL: SQLite itself takes any type anywhere."""

from typing import Final

from tbm_gsa.history.entries import KINDS
from tbm_msgs_py.base.texts import LONGEST_LINE

AXES: Final = ("x", "y", "z", "yz")


def _texts(*names: str) -> str:
    return " AND ".join(f"typeof({name}) = 'text' AND length({name}) <= {LONGEST_LINE}" for name in names)


def _whole(*names: str) -> str:
    """Whole numbers, of which the sum of two is still one."""
    return " AND ".join(f"typeof({name}) = 'integer' AND {name} BETWEEN -{2**62} AND {2**62}" for name in names)


def _numbers(*names: str) -> str:
    """Numbers; NULL are those that are not known."""
    return " AND ".join(f"typeof({name}) IN ('real', 'null')" for name in names)


_AXIS: Final = f"axis IN {AXES}"
_WINDOW_NUMBERS: Final = ("field_rms", "model_rms", "relative_error", "coverage", "field_peak", "field_kurtosis")

WINDOW: Final = " AND ".join(
    (
        _texts("kind", "name", "digest", "machine", "machine_sha256", "point"),
        _AXIS,
        _whole("start_ns", "length_ns"),
        _numbers(*_WINDOW_NUMBERS),
    )
)
BASELINE: Final = " AND ".join(
    (
        _texts("name", "machine", "machine_sha256"),
        _whole("created_ns", "since_ns", "until_ns"),
        f"(kind IS NULL OR kind IN {KINDS})",
    )
)
USUAL: Final = " AND ".join((_texts("point"), _AXIS, _numbers("mean", "scatter"), _whole("windows")))
