"""A part of a study that is run apart from the others, on a computer without a connection to them.

Every part holds the whole design, which is the same wherever it is made, and simulates its own rows: those whose
number leaves the same remainder.
"""

import re
from dataclasses import dataclass
from typing import Final, Self

from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py.base.texts import quoted

MOST: Final = 100_000


@dataclass(frozen=True)
class Shard:
    """Part `index` of `count`, from 1."""

    index: int
    count: int

    def __post_init__(self) -> None:
        if not 1 <= self.index <= self.count <= MOST:
            raise StudyError(f"shard {self}, allowed: I/N with I from 1 to N, N up to {MOST}")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read ``I/N``."""
        found = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text)
        if found is None:
            raise StudyError(f"shard {quoted(text)}, allowed: I/N, as 2/8 for the second of eight parts")
        return cls(int(found[1]), int(found[2]))

    def __str__(self) -> str:
        return f"{self.index}/{self.count}"


WHOLE: Final = Shard(1, 1)
