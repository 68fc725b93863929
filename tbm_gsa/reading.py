"""JSON of ours that is read back, from a file that anybody may have edited since: what is used of it is validated."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Final, NoReturn

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.files import read_text
from tbm_msgs_py.base.texts import LONGEST_LINE, LONGEST_NAME, shortened
from tbm_msgs_py.base.validation import first_problem

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
    InputError
        One line: the file, what of it is wrong, what is allowed.
    """
    try:
        text = read_text(file, largest=LARGEST_DOCUMENT)
    except OSError as error:
        raise InputError(f"{file}: {error.strerror}, allowed: {what}") from None
    except UnicodeDecodeError:
        raise InputError(f"{file}: no UTF-8 text, allowed: {what}") from None
    return validated(text, form, lambda problem: InputError(f"{file}: not {what} ({problem})"))


def validated(text: str, form: type[Part], refusal: Callable[[str], InputError]) -> dict[str, Any]:
    """Parse a JSON object and validate it; `refusal` makes the error of what is wrong with it."""
    try:
        document: dict[str, Any] = json.loads(text, parse_constant=_no_number)
        form.model_validate(document)
    except ValidationError as error:
        place, problem = first_problem(error, form)
        raise refusal(f"{f'{place}: ' if place else ''}{problem}") from None
    except RecursionError:
        raise refusal("nested too deeply") from None
    except ValueError as error:  # no JSON, a number of thousands of digits
        raise refusal(f"no JSON: {shortened(' '.join(str(error).split()), LONGEST_NAME)}") from None
    return document


def _no_number(name: str) -> NoReturn:
    """Refuse what Python writes and JSON does not have."""
    raise ValueError(f"{name} is no number")
