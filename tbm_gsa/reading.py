"""Results of ours as JSON: the base of their models, and how one is read back from a file that anybody may edit."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Final, Self, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)

from tbm_msgs_py.base import fields
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
Name = fields.Name
TextLine = Annotated[str, Field(max_length=LONGEST_LINE)]
PathText = Annotated[str, Field(max_length=4096)]


def _ordered(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise ValueError("the lower end of an interval is above the upper one")
    return ends


Interval = Annotated[tuple[Number, Number], AfterValidator(_ordered)]
Maybe = Annotated[
    float,
    Field(allow_inf_nan=True),
    BeforeValidator(lambda value: math.nan if value is None else value),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "null"}]}),
]
"""A number that is NaN, in JSON null, where it is not defined."""


_READ_BACK: Final = "read back"


class Part(BaseModel):
    """Base of a result and of its parts.

    What is built here has its own keys and no others. A document that is read back may be of another version: keys that
    this one does not know are left out.
    """

    # Not "forbid": pydantic decides that when the class is made, and reading is known when it happens.
    model_config = ConfigDict(frozen=True, extra="allow", strict=True, allow_inf_nan=False, protected_namespaces=())

    @model_validator(mode="after")
    def _own_keys(self, info: ValidationInfo) -> Self:
        if unknown := self.__pydantic_extra__:
            if info.context != _READ_BACK:
                raise ValueError(f"{', '.join(unknown)}: no keys of {type(self).__name__}")
            unknown.clear()
        return self


class MachineFile(Part):
    """Machine file that numbers come from, and the digest of what it says."""

    origin: PathText
    sha256: Name


Begin = Annotated[str, Field(max_length=40)]
"""Time of a first sample, ISO 8601 in UTC; empty where an earlier version wrote none."""


class RecordingFile(Part):
    """Recording that numbers come from."""

    path: PathText
    sha256: Name
    begin: Begin = ""


Read = TypeVar("Read")
PartT = TypeVar("PartT", bound=Part)


def read_document(file: Path, form: type[PartT], what: str, error: type[InputError] = InputError) -> PartT:
    """Read a result from its JSON file, which another version may have written.

    Parameters
    ----------
    file : Path
    form : type
        Model of the result.
    what : str
        What is allowed, for the message.
    error : type
        Kind of error that is raised.

    Raises
    ------
    InputError
        One line: the file, what of it is wrong, what is allowed.
    """
    try:
        text = read_text(file, largest=LARGEST_DOCUMENT)
    except OSError as problem:
        raise error(f"{file}: {problem.strerror}, allowed: {what}") from None
    except UnicodeDecodeError:
        raise error(f"{file}: no UTF-8 text, allowed: {what}") from None
    return validated(TypeAdapter(form), text, f"{file}: not {what}", error, form)


def validated(
    adapter: TypeAdapter[Read],
    text: str,
    refusal: str,
    error: type[InputError] = InputError,
    model: type[BaseModel] = Part,
) -> Read:
    """Read JSON that may have been edited since; an `error` holds the refusal and what of the model is wrong."""
    try:
        return adapter.validate_json(text, context=_READ_BACK)
    except ValidationError as problem:
        raise error(f"{refusal} ({_problem(problem, model)})") from None


def _problem(error: ValidationError, model: type[BaseModel]) -> str:
    """Return the first problem of a document, and its place."""
    first = error.errors(include_url=False)[0]
    if first["type"] == "json_invalid":
        return f"no JSON: {shortened(first['ctx']['error'], LONGEST_NAME)}"
    place, problem = first_problem(error, model)
    choices = {one.__name__ for one in Part.__subclasses__()}  # members of a choice are no keys
    place = ".".join(part for part in place.split(".") if part not in choices)
    return f"{place}: {problem}" if place else problem
