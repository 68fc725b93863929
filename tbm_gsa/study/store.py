"""The SQLite store of a study: the problem, the design and every finished simulation.

A simulation is committed when it finishes, so a killed campaign loses only what was running.
"""

import json
import sqlite3
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal, Self

import numpy as np

from tbm_gsa.arrays import Array
from tbm_gsa.study.design import latin_hypercube
from tbm_gsa.study.errors import StudyError
from tbm_gsa.study.inputs import InputSet
from tbm_gsa.study.worker import Outcome

Part = Literal["train", "test"]
Setting = str | float | int
FORMAT: Final = 1
SCHEMA: Final = """
CREATE TABLE problem (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE simulations (
    row INTEGER PRIMARY KEY,
    part TEXT NOT NULL CHECK (part IN ('train', 'test')),
    inputs TEXT NOT NULL,
    status TEXT NOT NULL DEFAULT 'pending' CHECK (status IN ('pending', 'ok', 'failed')),
    outputs TEXT,
    reason TEXT,
    seconds REAL
);
"""


@dataclass(frozen=True)
class Problem:
    """What a store answers; two stores with equal problems hold equal numbers.

    Parameters
    ----------
    inputs : InputSet
    outputs : tuple of str
        Names an evaluation returns.
    train, test, seed : int
        Of the design.
    settings : mapping of str to str, float or int
        What the evaluation depends on besides its inputs: machine, duration, load seed.
    """

    inputs: InputSet
    outputs: tuple[str, ...]
    train: int
    test: int
    seed: int
    settings: Mapping[str, Setting] = field(default_factory=dict)

    def to_json(self) -> dict[str, str]:
        """Every part as one JSON text."""
        parts = {
            "format": FORMAT,
            "inputs": self.inputs.to_list(),
            "outputs": self.outputs,
            "train": self.train,
            "test": self.test,
            "seed": self.seed,
            "settings": dict(self.settings),
        }
        return {key: json.dumps(value, sort_keys=True, ensure_ascii=False) for key, value in parts.items()}

    @classmethod
    def from_json(cls, texts: Mapping[str, str]) -> Self:
        """Inverse of `to_json`."""
        parts = {key: json.loads(text) for key, text in texts.items()}
        if parts.pop("format", None) != FORMAT:
            raise StudyError(f"the store was written in another format than {FORMAT}, the one this version reads")
        return cls(
            InputSet.from_list(parts["inputs"]),
            tuple(parts["outputs"]),
            parts["train"],
            parts["test"],
            parts["seed"],
            parts["settings"],
        )


@dataclass(frozen=True)
class Counts:
    """Numbers of simulations: planned, ended well, failed."""

    total: int
    ok: int
    failed: int

    @property
    def done(self) -> int:
        """Ended either way."""
        return self.ok + self.failed


class Store:
    """An open store. Use `create_or_open` or `open`, and close it or use it as a context manager."""

    def __init__(self, path: Path, connection: sqlite3.Connection, problem: Problem) -> None:
        self.path = path
        self.problem = problem
        self._connection = connection

    @classmethod
    def create_or_open(cls, path: Path, problem: Problem) -> Self:
        """Open the store of a problem; write it with its design first if there is none.

        Raises
        ------
        StudyError
            The file is a store of another problem, or no store.
        """
        if path.exists():
            store = cls.open(path)
            difference = _difference(store.problem, problem)
            if difference:
                store.close()
                raise StudyError(f"{path}: holds another study: {difference}")
            return store
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_name(path.name + ".new")
        unfinished.unlink(missing_ok=True)
        connection = _connect(unfinished)
        _write_problem(connection, problem)
        connection.close()
        unfinished.rename(path)  # a store exists with its whole design or not at all
        return cls.open(path)

    @classmethod
    def open(cls, path: Path) -> Self:
        """Open an existing store."""
        if not path.is_file():
            raise StudyError(f"{path}: no such store")
        connection = _connect(path)
        try:
            connection.execute("PRAGMA journal_mode=WAL")
            problem = Problem.from_json(dict(connection.execute("SELECT key, value FROM problem")))
        except sqlite3.DatabaseError as error:
            connection.close()
            raise StudyError(f"{path}: not a store of a sensitivity study ({error})") from None
        except StudyError as error:
            connection.close()
            raise StudyError(f"{path}: {error}") from None
        return cls(path, connection, problem)

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def pending(self) -> list[tuple[int, dict[str, float]]]:
        """Row and inputs of every simulation that has not ended, in order."""
        rows = self._connection.execute("SELECT row, inputs FROM simulations WHERE status = 'pending' ORDER BY row")
        return [(row, self.problem.inputs.sample(json.loads(inputs))) for row, inputs in rows]

    def record(self, outcome: Outcome) -> None:
        """Commit one finished simulation."""
        status = "failed" if outcome.outputs is None else "ok"
        outputs = None
        if outcome.outputs is not None:
            outputs = json.dumps([outcome.outputs[name] for name in self.problem.outputs])
        with self._connection:
            self._connection.execute(
                "UPDATE simulations SET status = ?, outputs = ?, reason = ?, seconds = ? WHERE row = ?",
                (status, outputs, outcome.reason, outcome.seconds, outcome.row),
            )

    def counts(self) -> Counts:
        """How far the campaign is."""
        by_status = dict(self._connection.execute("SELECT status, COUNT(*) FROM simulations GROUP BY status"))
        return Counts(sum(by_status.values()), by_status.get("ok", 0), by_status.get("failed", 0))

    def results(self, part: Part) -> tuple[Array, Array]:
        """Read inputs (n, d) and outputs (n, q) of the simulations that ended well, in the order of the design."""
        rows = self._connection.execute(
            "SELECT inputs, outputs FROM simulations WHERE part = ? AND status = 'ok' ORDER BY row", (part,)
        ).fetchall()
        X = np.array([json.loads(inputs) for inputs, _ in rows]).reshape(len(rows), len(self.problem.inputs))
        Y = np.array([json.loads(outputs) for _, outputs in rows]).reshape(len(rows), len(self.problem.outputs))
        return X, Y

    def failures(self) -> list[tuple[int, str]]:
        """Row and reason of every failed simulation."""
        return list(
            self._connection.execute("SELECT row, reason FROM simulations WHERE status = 'failed' ORDER BY row")
        )

    def simulation_seconds(self) -> float:
        """Processor time that all simulations took together, s."""
        total = self._connection.execute("SELECT TOTAL(seconds) FROM simulations").fetchone()[0]
        return float(total)


def _connect(path: Path) -> sqlite3.Connection:
    """Connect to a file, waiting for another reader or writer for up to 30 s."""
    return sqlite3.connect(path, timeout=30.0)


def _write_problem(connection: sqlite3.Connection, problem: Problem) -> None:
    """Write schema, problem and design of a new store."""
    design = latin_hypercube(problem.inputs, problem.train, problem.test, problem.seed)
    connection.executescript(SCHEMA)
    with connection:
        connection.executemany("INSERT INTO problem VALUES (?, ?)", problem.to_json().items())
        connection.executemany("INSERT INTO simulations (part, inputs) VALUES (?, ?)", _planned(design.train, "train"))
        connection.executemany("INSERT INTO simulations (part, inputs) VALUES (?, ?)", _planned(design.test, "test"))


def _planned(points: Array, part: Part) -> Iterator[tuple[str, str]]:
    """Rows of planned simulations; JSON keeps every bit of a float."""
    return ((part, json.dumps(point)) for point in points.tolist())


def _difference(stored: Problem, wanted: Problem) -> str | None:
    """Say in words where two problems differ first; None if they are equal."""
    there, here = stored.to_json(), wanted.to_json()
    if there["settings"] != here["settings"]:
        for key in sorted({*stored.settings, *wanted.settings}):
            old, new = stored.settings.get(key), wanted.settings.get(key)
            if old != new:
                return f"{key} is {old!r} there and {new!r} here"
    for key in ("train", "test", "seed", "outputs"):
        if there[key] != here[key]:
            return f"{key} is {there[key]} there and {here[key]} here"
    for old_input, new_input in zip(stored.inputs.inputs, wanted.inputs.inputs, strict=False):
        if old_input != new_input:
            return f"its input {old_input.code} differs from {new_input.code} here in code, range or initial value"
    return None if there == here else f"it has {len(stored.inputs)} inputs, not {len(wanted.inputs)}"
