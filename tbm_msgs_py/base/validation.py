"""Contents of files against their model, and its validation errors in one line."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import TypeVar, get_args

from pydantic import BaseModel, ValidationError

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.texts import LONGEST_NAME, quoted, shortened

ModelT = TypeVar("ModelT", bound=BaseModel)


def validated(model: type[ModelT], content: object, label: str, error: type[InputError] = InputError) -> ModelT:
    """Model of the content of a file; an `error` says what of it, which messages call `label`, is wrong first."""
    try:
        return model.model_validate(content)
    except ValidationError as found:
        raise error(f"{label}: {first_problem(found, model)}") from None


def first_problem(error: ValidationError, model: type[BaseModel] | None = None, choices: Collection[str] = ()) -> str:
    """Place of the first problem of a validation, unless it is the whole, and what is wrong and allowed there.

    A misspelt key is also a missing one: the misspelling comes first.

    Parameters
    ----------
    error : ValidationError
    model : type, optional
        What was validated; it says which keys there may be in place of an unknown one.
    choices : collection of str
        Members of choices, which are no keys; nor are those whose names begin with ``_``.
    """
    first = min(error.errors(include_url=False), key=lambda problem: problem["type"] != "extra_forbidden")
    keys = [str(part) for part in first["loc"] if part not in choices and not str(part).startswith("_")]
    place = shortened(".".join(keys), LONGEST_NAME)
    problem = _problem(first["type"], first["msg"], first["input"], first["loc"], model)
    return f"{place}: {problem}" if place else problem


def _problem(
    kind: str, message: str, given: object, place: tuple[int | str, ...], model: type[BaseModel] | None
) -> str:
    if kind == "missing":
        return "missing, allowed: a value that is stated"
    if kind == "extra_forbidden" and model is not None:
        return f"unknown key, allowed: {', '.join(_keys_beside(place, model))}"
    if kind != "value_error":
        allowed = re.sub(r"^\w+ should (be|have) ", "", message)
        return f"{quoted(given)}, allowed: {allowed}"
    message = message.removeprefix("Value error, ")
    # Of a whole entry, the message says which of its values is wrong.
    return message if isinstance(given, dict) else f"{message}, given: {quoted(given)}"


def _keys_beside(place: tuple[int | str, ...], model: type[BaseModel]) -> list[str]:
    """Keys that there may be beside the one at a place of a model."""
    models = [model]
    for part in place[:-1]:
        fields = [one.model_fields[part] for one in models if isinstance(part, str) and part in one.model_fields]
        # Numbers of a list, keys of a mapping and members of a choice stay in the same models.
        models = [found for field in fields for found in _models_in(field.annotation)] or models
    return list(dict.fromkeys(key for one in models for key in one.model_fields))


def _models_in(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [found for part in get_args(annotation) for found in _models_in(part)]
