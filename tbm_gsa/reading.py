"""JSON of ours that is read back, from a file that anybody may have edited since: what is used of it is validated."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final, NoReturn

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py.base.bounds import LONGEST_LINE, LONGEST_NAME, quoted, read_text, shortened

LARGEST_DOCUMENT: Final = 256 << 20
"""Bytes of a document: a comparison of hours of recording is tens of megabytes."""

LARGEST_NUMBER: Final = 1e30
"""Of a finite number in a document of ours: beyond it squares and products of a few overflow."""

Number = Annotated[float, Field(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
Size = Annotated[float, Field(ge=0.0, le=LARGEST_NUMBER)]
Seed = Annotated[int, Field(ge=0, lt=2**31)]
Name = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME)]
Line = Annotated[str, Field(max_length=LONGEST_LINE)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]


class Part(BaseModel):
    """Base of what is used of a document; other keys may stand beside it."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)


class MachineFile(Part):
    """Machine file that numbers come from, and the digest of what it says."""

    origin: Line
    sha256: Name


class RecordingFile(Part):
    """Recording that numbers come from."""

    path: Line
    sha256: Name


def read_document(file: Path, form: type[Part], what: str) -> dict[str, Any]:
    """Read a JSON document that holds at least what its form asks for.

    Parameters
    ----------
    file : Path
    form : type
        What is used of it.
    what : str
        What is allowed, for the message.

    Raises
    ------
    StudyError
        One line: the file, what of it is wrong, what is allowed.
    """
    try:
        text = read_text(file, largest=LARGEST_DOCUMENT)
    except OSError as error:
        raise StudyError(f"{file}: {error.strerror}, allowed: {what}") from None
    except UnicodeDecodeError:
        raise StudyError(f"{file}: no UTF-8 text, allowed: {what}") from None
    return validated(text, form, lambda problem: StudyError(f"{file}: not {what} ({problem})"))


def validated(text: str, form: type[Part], refusal: Callable[[str], StudyError]) -> dict[str, Any]:
    """Parse a JSON object and validate it; `refusal` makes the error of what is wrong with it."""
    try:
        document: dict[str, Any] = json.loads(text, parse_constant=_no_number)
        form.model_validate(document)
    except ValidationError as error:
        raise refusal(_problem(error)) from None
    except RecursionError:
        raise refusal("nested too deeply") from None
    except ValueError as error:  # no JSON, a number of thousands of digits
        raise refusal(f"no JSON: {shortened(' '.join(str(error).split()), LONGEST_NAME)}") from None
    return document


def _problem(error: ValidationError) -> str:
    """Say what of a document is wrong first."""
    first = error.errors(include_url=False)[0]
    # The forms of a choice begin with _ and are no keys.
    place = shortened(".".join(str(part) for part in first["loc"] if not str(part).startswith("_")), LONGEST_NAME)
    if first["type"] == "missing":
        return f"{place}: missing"
    given = first["input"]
    shown = f", given: {quoted(given)}" if isinstance(given, str | int | float | None) else ""
    return f"{place + ': ' if place else ''}{first['msg'].removeprefix('Value error, ')}{shown}"


def _no_number(name: str) -> NoReturn:
    """Refuse what Python writes and JSON does not have."""
    raise ValueError(f"{name} is no number")
