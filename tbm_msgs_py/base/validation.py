"""Contents of files against their model, and its validation errors in one line."""

from __future__ import annotations

import re
from typing import TypeVar, get_args

from pydantic import BaseModel, ValidationError

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.texts import LONGEST_NAME, quoted, shortened

ModelT = TypeVar("ModelT", bound=BaseModel)
# Members of a choice, which are no keys: those whose names begin with _, and what pydantic calls others.
_ALLOWED = {
    "dict_type": "a mapping",
    "tuple_type": "a list, as [a, b, c]",
    "list_type": "a list, as [a, b, c]",
    "string_type": "a text; what YAML reads as something else, such as a number, in quotes",
}
_OF_CHOICE = re.compile(r"_|(function-\w+|literal|constrained-\w+|nullable|list|tuple|dict)\[")


def validated(model: type[ModelT], content: object, label: str, error: type[InputError] = InputError) -> ModelT:
    """Model of the content of a file; an `error` says what of it, which messages call `label`, is wrong first."""
    try:
        return model.model_validate(content)
    except ValidationError as found:
        place, problem = first_problem(found, model)
        raise error(f"{label}: {f'{place}: ' if place else ''}{problem}") from None


def first_problem(error: ValidationError, model: type[BaseModel]) -> tuple[str, str]:
    """Place of the first problem of a validation, empty for the whole, and what is wrong and allowed there.

    A misspelt key is also a missing one: the misspelling comes first.
    """
    problems = error.errors(include_url=False)
    first = min(problems, key=lambda problem: problem["type"] != "extra_forbidden")
    place = _place(first["loc"])
    problem = _problem(first["type"], first["msg"], first["input"], first["loc"], model)
    if first["type"] == "model_type":  # in a choice, a word may stand in the place of the mapping
        words = [one for one in problems if one["type"] == "literal_error" and _place(one["loc"]) == place]
        problem += "".join(f", or {one['ctx']['expected']}" for one in words)
    return shortened(place, LONGEST_NAME), problem


def _place(location: tuple[int | str, ...]) -> str:
    return ".".join(str(part) for part in location if not _OF_CHOICE.match(str(part)))


def _problem(kind: str, message: str, given: object, place: tuple[int | str, ...], model: type[BaseModel]) -> str:
    if kind in _ALLOWED:
        return f"{quoted(given)}, allowed: {_ALLOWED[kind]}"
    if kind == "model_type":
        return f"{quoted(given)}, allowed: a mapping with keys of {', '.join(_keys_beside((*place, ''), model))}"
    if kind == "missing":
        return "missing, allowed: a value that is stated"
    if kind == "extra_forbidden":
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
