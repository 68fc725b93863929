"""What a result of a recording was made from, for every result says it."""

# Annotations as they are, no texts: models with this class in them look names up elsewhere with pydantic below 2.6.
from dataclasses import dataclass
from typing import Final

from tbm_msgs_py.base.texts import listed
from tbm_msgs_py.recordings.joint_states import ClockName

BY_PROGRAM: Final = "given by the program, no file"


@dataclass(frozen=True)
class UsedSources:
    """Files, topics and clocks that the numbers of a recording come from.

    Attributes
    ----------
    mapping : str or None
        File that says which topic is which test point, absolute, or `BY_PROGRAM`; None: the topics of the contract.
    operating_point : str or None
        Topic of the operating point; None where the recording's is not used.
    operating_entries : int
        Operating points in it.
    operating_clock : {"header stamps", "log times"} or None
        Where the times of the operating points come from.
    placed : tuple of str
        Test points whose clock is another than that of the others: placed beside them by the log times.
    drives : str or None
        Topic of the drives; None where there is none.
    """

    mapping: str | None = None
    operating_point: str | None = None
    operating_entries: int = 0
    operating_clock: ClockName | None = None
    placed: tuple[str, ...] = ()
    drives: str | None = None

    @property
    def clock(self) -> str:
        """Where the times of the samples come from."""
        return "header stamps" + (f", beginning by the log times at {listed(self.placed)}" if self.placed else "")

    def lines(self) -> list[str]:
        """Say it, a line each."""
        count = "1 entry" if self.operating_entries == 1 else f"{self.operating_entries} entries"
        operating = "none of the recording"
        if self.operating_point is not None:
            operating = f"{self.operating_point}, {count}, by {self.operating_clock}"
        return [
            f"mapping: {self.mapping or 'none, the topics of the contract'}",
            f"operating point: {operating}",
            f"clock: {self.clock}",
            *([f"drives: {self.drives}"] if self.drives else []),
        ]
