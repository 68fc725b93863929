"""What a study asks: everything that its numbers depend on."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Final

import numpy as np
from pydantic import ConfigDict, Field, TypeAdapter

from tbm_gsa.reading import Name, Seed, TextLine, validated
from tbm_gsa.sensitivity.study.design import check_kind
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_gsa.sensitivity.study.outputs import check_distinct, gathered_outputs
from tbm_msgs_py.base.arrays import Integers
from tbm_msgs_py.base.texts import shortened

Setting = TextLine | float | int
Simulations = Annotated[int, Field(ge=0, lt=2**31)]
FORMAT: Final = 2
DIGEST: Final = "machine_sha256"
OF_MACHINE: Final = ("machine", "speed_r_min", "torque_kn_m", "thrust_kn")
"""Settings that the digest of the machine holds; a store of before does not have all of them."""


@dataclass(frozen=True)
class StudyProblem:
    """What a store answers; two stores with equal problems hold equal numbers.

    Parameters
    ----------
    inputs : InputSet
    outputs : tuple of str
        Names an evaluation returns.
    train, test, seed : int
        Of the first design.
    settings : mapping of str to str, float or int
        What the evaluation depends on besides its inputs: machine, duration, load seed.
    design : str
        Kind of the first design, see `make_design`.
    added : tuple of int
        Numbers of training points added since, one after the other, see `add_points`.
    realisations : int
        Realisations of the loads that the simulations of the first design share out; 0 where all share one, or there
        are no loads. Points added later come with further ones, in proportion.
    """

    __pydantic_config__: ClassVar = ConfigDict(strict=True)  # of what is read from a store
    inputs: InputSet
    outputs: tuple[Name, ...]
    train: Simulations
    test: Simulations
    seed: Seed
    settings: Mapping[Name, Setting] = field(default_factory=dict)
    design: str = "lhs"
    added: tuple[Simulations, ...] = ()
    realisations: Simulations = 0

    def __post_init__(self) -> None:
        check_kind(self.design)
        if not self.outputs:
            raise StudyError("outputs: none, allowed: at least one")
        check_distinct(self.outputs)

    def realisations_of_rows(self) -> Integers:
        """Realisation of the loads of every simulation (n,), in the order of the store, numbered from 0.

        Those of the first design are dealt out in equal parts and at random: a regular deal would follow the order of
        a low-discrepancy sequence. The test points share the same ones.
        """
        generator = np.random.default_rng([self.seed, *b"loads"])
        dealt, known = [], 0
        for count in (self.train, *self.added):
            number = max(1, round(self.realisations * count / max(1, self.train)))
            dealt.append(known + generator.permutation(np.arange(count) % number))
            known += number
        dealt.insert(1, np.arange(self.test) % max(1, self.realisations))
        return np.concatenate(dealt)

    def to_json(self) -> dict[str, str]:
        """Every part as one JSON text."""
        inputs = [item.to_dict() for item in self.inputs.inputs]
        parts = {"format": FORMAT, **vars(self), "inputs": inputs, "groups": self.inputs.groups}
        return {key: json.dumps(value, ensure_ascii=False) for key, value in parts.items()}

    @staticmethod
    def from_json(texts: Mapping[str, str]) -> "StudyProblem":
        """Inverse of `to_json`."""
        written = texts.get("format")
        if written != str(FORMAT):
            raise StudyError(f"written in format {shortened(str(written), 20)}, allowed: {FORMAT}; run the study again")
        parts = {key: str(text) for key, text in texts.items()}
        parts["inputs"] = _object({key: parts.pop(key, "null") for key in ("inputs", "groups")})
        return validated(_STORED_PROBLEM, _object(parts), "not the problem of a study", StudyError)


_STORED_PROBLEM: Final = TypeAdapter(StudyProblem)


def _object(texts: Mapping[str, str]) -> str:
    """Join JSON texts to one of a mapping."""
    return "{" + ", ".join(f"{json.dumps(key)}: {text}" for key, text in texts.items()) + "}"


def difference(stored: StudyProblem, wanted: StudyProblem) -> str | None:
    """Return the first difference of two problems in words; None if their simulations are the same.

    Groups say which indices are added up, and nothing about simulations; the machine is known by its digest, wherever
    its file is.
    """
    return next(_differences(stored, wanted), None)


def _loads(problem: StudyProblem) -> str:
    return f"{problem.realisations} realisations" if problem.realisations else "common to all"


def _differences(stored: StudyProblem, wanted: StudyProblem) -> Iterator[str]:
    digests = [problem.settings.get(DIGEST) for problem in (stored, wanted)]
    of_machine = OF_MACHINE if digests[0] is not None and digests[0] == digests[1] else ()
    for key in sorted({*stored.settings, *wanted.settings}.difference(of_machine)):
        old, new = stored.settings.get(key), wanted.settings.get(key)
        if old != new:
            yield f"{key} is {old!r} there and {new!r} here"
    for key in ("train", "test", "seed", "design"):
        old, new = getattr(stored, key), getattr(wanted, key)
        if old != new:
            yield f"{key} is {old} there and {new} here"
    if stored.realisations != wanted.realisations:
        yield f"its loads are {_loads(stored)}, here {_loads(wanted)}"
    if stored.outputs != wanted.outputs:
        there, here = (", ".join(gathered_outputs(problem.outputs)) for problem in (stored, wanted))
        yield f"its outputs are {there}, here {here}"
    for old_input, new_input in zip(stored.inputs.inputs, wanted.inputs.inputs, strict=False):
        if old_input != new_input:
            yield f"its input {old_input.code} is not the {new_input.code} of here (code, distribution, initial value)"
    if len(stored.inputs) != len(wanted.inputs):
        yield f"it has {len(stored.inputs)} inputs, not {len(wanted.inputs)}"
    if stored.added != wanted.added:
        yield f"{sum(stored.added)} points were added to its design; `gsa resume` goes on with it"
