"""What a study can end with, each with one line for the user."""

from typing import TypeVar

from pydantic import TypeAdapter, ValidationError

from tbm_msgs_py.base.errors import InputError, RunError
from tbm_msgs_py.base.texts import LONGEST_NAME, shortened

Stored = TypeVar("Stored")


class StudyError(InputError):
    """Bad input to a study: an input set, a store of another study, too few finished simulations."""


class StudyCancelled(RunError):  # noqa: N818 - the store is complete up to here and can be resumed
    """The study was cancelled; what has finished is in the store."""


def validated(adapter: TypeAdapter[Stored], text: str | bytes, refusal: str) -> Stored:
    """Read JSON of a study that may have been edited since; raise a StudyError with the refusal and what is wrong."""
    try:
        return adapter.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = shortened(".".join(map(str, first["loc"])), LONGEST_NAME)
        problem = first["msg"].removeprefix("Value error, ")
        raise StudyError(f"{refusal} ({place + ': ' if place else ''}{problem})") from None
