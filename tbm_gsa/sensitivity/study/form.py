"""What a store of a study may say of its problem and of its simulations; its file may have been edited since."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from tbm_gsa.reading import Line, Name, Number, Part, Seed, validated
from tbm_gsa.sensitivity.study.errors import StudyError

Count = Annotated[int, Field(ge=0, lt=2**31)]


class ProblemForm(Part):
    """Parts of a `Problem`, as `Problem.to_json` writes them."""

    inputs: list[dict[Name, Line | Number]]
    groups: dict[Name, list[Name]]
    outputs: list[Name]
    train: Count
    test: Count
    seed: Seed
    settings: dict[Name, Line | int | float]
    design: Name
    added: list[Count]


class _Row(Part):
    numbers: list[Number]


def problem_parts(texts: Mapping[str, str]) -> dict[str, Any]:
    """Validate the parts of a problem, each one JSON text; a StudyError says which is wrong."""
    joined = "{" + ", ".join(f"{json.dumps(key)}: {text}" for key, text in texts.items()) + "}"
    validated(joined, ProblemForm, lambda problem: StudyError(f"not the problem of a study ({problem})"))
    parts: dict[str, Any] = json.loads(joined)  # numbers stay whole where they are
    return parts


def numbers(text: object, count: int) -> list[float]:
    """Read the inputs or outputs of a simulation; a StudyError unless they are so many numbers."""
    joined = f'{{"numbers": {text}}}'
    found = validated(joined, _Row, lambda problem: StudyError(f"a simulation is not one of this study ({problem})"))
    if len(found.numbers) != count:
        raise StudyError(f"a simulation of {len(found.numbers)} numbers, allowed: {count}")
    return found.numbers
