"""The result of a reproduction, line by line; its JSON keys are a contract, docs/reproduction.md lists them."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Final, Self

from pydantic import computed_field
from pydantic.dataclasses import dataclass

from tbm_gsa.paper.published import TEST, TRAIN
from tbm_gsa.paper.reproduction.verdict import VERDICTS, RowVerdict
from tbm_gsa.reading import MachineFile, Name, Part, RecordingFile, Seed, TextLine

Value = int | float | str | None

SOURCES: Final = (*(f"Table {k}" for k in range(1, 7)), *(f"Figure {k}" for k in range(2, 16)))
"""Tables and figures of the paper that are reproduced, in order."""

COMMON_LOADS: Final = "one realisation, common to all simulations, as in the paper"


@dataclass(frozen=True)
class Row:
    """One value or statement of the paper, and ours.

    Attributes
    ----------
    id : str
        Unique; begins with the table or figure, as in ``table2.shield.error``, and ends in ``@READING`` where it
        belongs to the reading of the dampings that is not the machine's.
    what : str
        What is compared.
    paper, ours : int, float, str or None
        Numbers where both are numbers, else short statements.
    verdict : RowVerdict
    note : str
        Where our value comes from, or why it differs; may be empty.
    unit : str
    reading : str or None
        Of the dampings; None where they have no part in it.
    """

    id: str
    what: str
    paper: Value
    ours: Value
    verdict: RowVerdict
    note: str = ""
    unit: str = ""
    reading: str | None = None

    @computed_field  # type: ignore[prop-decorator]
    @property
    def source(self) -> str:
        """Table or figure of the paper."""
        kind = "table" if self.id.startswith("table") else "figure"
        return f"{kind.title()} {self.id.partition('.')[0].removeprefix(kind)}"

    @computed_field  # type: ignore[prop-decorator]
    @property
    def difference(self) -> float | None:
        """Ours less the paper's, where both are numbers."""
        if isinstance(self.paper, int | float) and isinstance(self.ours, int | float):
            return float(self.ours) - float(self.paper)
        return None

    def noted(self, text: str) -> Self:
        """Row with more in its note."""
        return replace(self, note=f"{self.note}; {text}" if self.note else text)


def count_verdicts(rows: Iterable[Row]) -> dict[RowVerdict, int]:
    """Count rows by verdict."""
    given = [row.verdict for row in rows]
    return {name: given.count(name) for name in VERDICTS}


@dataclass(frozen=True)
class Sizes:
    """How much is simulated; the defaults are the paper's numbers and what shows its lines.

    Attributes
    ----------
    train, test : int
        Simulations of each campaign.
    other_train : int
        Instead of `train` under the other reading: light damping lets teeth part, and a run takes four times as long.
    simulation_s : float
        Length of each.
    run_s, model_s, loads_s : float
        Of the response run, of the run beside the recording, of the loads.
    whole_study : bool
        Whether the machine's own reading gets the whole study: sampling, screening and a report of its own.
    """

    train: int = TRAIN
    test: int = TEST
    other_train: int = TRAIN // 2
    simulation_s: float = 3.0
    run_s: float = 40.0
    model_s: float = 60.0
    loads_s: float = 600.0
    whole_study: bool = True


class ReadingSummary(Part):
    """Name of a reading of the dampings, in words, whether it is the machine's own and was fitted under."""

    name: Name
    title: TextLine
    own: bool
    fitted: bool


class ReproducedRecording(RecordingFile):
    """Recording that Table 2 and Figure 7 are held against."""

    synthetic: bool


class ReproductionResult(Part):
    """A reproduction; equal inputs and seed give equal ones but for `seconds`.

    Attributes
    ----------
    rows : tuple of Row
    verdicts, other_reading : dict of str to int
        Rows by verdict, of the machine's own reading of the dampings and of the other one.
    readings : tuple of ReadingSummary
        The machine's own first.
    machine, machine_file, recording, seed, sizes
        What was reproduced, with what.
    loads : str
        How the simulations of a campaign come by their loads.
    versions : dict of str to str
    seconds : dict of str to float
        By stage, and ``total``.
    """

    rows: tuple[Row, ...]
    verdicts: dict[RowVerdict, int]
    other_reading: dict[RowVerdict, int]
    readings: tuple[ReadingSummary, ...]
    machine: Name
    machine_file: MachineFile
    recording: ReproducedRecording
    seed: Seed
    sizes: Sizes
    loads: TextLine = COMMON_LOADS
    versions: dict[Name, TextLine]
    seconds: dict[Name, float]

    def rows_of(self, *readings: str | None) -> list[Row]:
        """Rows of some readings; None stands for those in which the dampings have no part."""
        return [row for row in self.rows if row.reading in readings]

    @property
    def own_rows(self) -> list[Row]:
        """Rows under the machine's own reading, and those in which the dampings have no part."""
        return self.rows_of(None, self.readings[0].name)

    @property
    def differing(self) -> list[Row]:
        """Rows that differ from the paper, the other reading left out."""
        return [row for row in self.own_rows if row.verdict == "differs"]
