"""One line of the reproduction: a value or statement of the paper, and ours."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final, Self

from tbm_gsa.paper.reproduction.verdict import VERDICTS, Verdict

Value = float | str | None

SOURCES: Final = (*(f"Table {k}" for k in range(1, 7)), *(f"Figure {k}" for k in range(2, 16)))
"""Tables and figures of the paper that are reproduced, in order."""


@dataclass(frozen=True)
class Row:
    """A line.

    Attributes
    ----------
    id : str
        Unique; ends in ``@READING`` where the row belongs to the reading of the dampings that is not the machine's.
    source : str
        Table or figure of the paper.
    what : str
        What is compared.
    paper, ours : float, str or None
        Numbers where both are numbers, else short statements.
    verdict : Verdict
    note : str
        Where our value comes from, or why it differs; may be empty.
    unit : str
    reading : str or None
        Of the dampings; None where they have no part in it.
    """

    id: str
    source: str
    what: str
    paper: Value
    ours: Value
    verdict: Verdict
    note: str = ""
    unit: str = ""
    reading: str | None = None

    @property
    def difference(self) -> float | None:
        """Ours less the paper's, where both are numbers."""
        both = isinstance(self.paper, int | float) and isinstance(self.ours, int | float)
        return float(self.ours) - float(self.paper) if both else None  # type: ignore[arg-type]

    def noted(self, text: str) -> Self:
        """Give the same row with more in its note."""
        return replace(self, note=f"{self.note}; {text}" if self.note else text)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return {**asdict(self), "difference": self.difference}


def count_verdicts(rows: Sequence[Row]) -> dict[str, int]:
    """Count rows by verdict."""
    return {name: sum(row.verdict == name for row in rows) for name in VERDICTS}
