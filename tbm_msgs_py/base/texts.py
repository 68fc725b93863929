"""Texts of a machine file."""

from typing import Annotated, Final

from pydantic import AfterValidator, Field

from tbm_msgs_py.base.bounds import LONGEST_LINE, LONGEST_NAME


def _printable(text: str) -> str:
    """Text that a terminal, a picture and a page can show."""
    if not text.isprintable():
        raise ValueError("must be one line of printable characters")
    return text


Label = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(_printable)]
Line = Annotated[str, Field(min_length=1, max_length=LONGEST_LINE), AfterValidator(_printable)]
Source = Line
"""Where a value is from: one of `SOURCES`, or the user's own words, as `drawing 4711, rev. B`."""

SOURCES: Final = ("table1", "table4", "table5", "assumed", "calibrated", "updated")
"""Sources with a meaning: tables of the paper, ours, fitted by the calibration, changed to explain a recording."""
