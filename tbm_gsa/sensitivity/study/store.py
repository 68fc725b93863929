"""The SQLite store of a study: the problem, the design and every finished simulation.

A simulation is committed when it finishes, so a killed campaign loses only what was running.
"""

import json
import sqlite3
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter

from tbm_gsa.reading import Number, validated
from tbm_gsa.sensitivity.study.design import add_points, make_design
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.problem import StudyProblem, difference
from tbm_gsa.sensitivity.study.shards import WHOLE, Shard
from tbm_gsa.sensitivity.study.workers import Outcome
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.files import unfinished
from tbm_msgs_py.base.texts import shortened

STORE_NAME: Final = "store.sqlite"
DesignPart = Literal["train", "test"]
SCHEMA: Final = """
CREATE TABLE problem (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE designs (
    design INTEGER PRIMARY KEY,
    part TEXT NOT NULL CHECK (part IN ('train', 'test')),
    kind TEXT NOT NULL,
    seed INTEGER NOT NULL
);
CREATE TABLE simulations (
    row INTEGER PRIMARY KEY,
    design INTEGER NOT NULL REFERENCES designs,
    inputs TEXT NOT NULL,
    status TEXT NOT NULL DEFAULT 'pending' CHECK (status IN ('pending', 'ok', 'failed')),
    outputs TEXT,
    reason TEXT,
    seconds REAL
);
CREATE VIEW planned AS SELECT * FROM simulations JOIN designs USING (design);
"""
TEST_DESIGN: Final = "lhs"
_END: Final = "UPDATE simulations SET status = ?, outputs = ?, reason = ?, seconds = ? WHERE row = ?"
_NUMBERS: Final = TypeAdapter(list[Number], config=ConfigDict(strict=True))


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


@dataclass(frozen=True)
class EndedRow:
    """A simulation that ended: its inputs as they are stored, and what became of it."""

    inputs: str
    outcome: Outcome


class Store:
    """An open store. Use `create_or_open` or `open`, and close it or use it as a context manager."""

    def __init__(self, path: Path, connection: sqlite3.Connection, problem: StudyProblem) -> None:
        self.path = path
        self.problem = problem
        self._connection = connection

    @classmethod
    def create_or_open(cls, path: Path, problem: StudyProblem) -> Self:
        """Open the store of a problem; write it with its design first if there is none.

        Groups, and another place of the same machine file, are taken over: they say nothing about simulations.

        Raises
        ------
        StudyError
            The file is a store of another problem, or no store.
        """
        if path.exists():
            store = cls.open(path)
            differs = difference(store.problem, problem)
            if differs:
                store.close()
                raise StudyError(f"{path}: holds another study ({differs}), allowed: the same one, or another folder")
            store._take_over(problem)
            return store
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with unfinished(path) as fresh, closing(_connect(fresh)) as connection:
                _write_problem(connection, problem)  # a store exists with its whole design or not at all
        except sqlite3.Error as error:
            raise StudyError(f"{path}: {error}, allowed: a folder that can be written to") from None
        return cls.open(path)

    @classmethod
    def open(cls, path: Path) -> Self:
        """Open an existing store."""
        if not path.is_file():
            raise StudyError(f"{path}: no such store, allowed: the folder of a study that was begun")
        connection = _connect(path)
        try:
            problem = StudyProblem.from_json(dict(connection.execute("SELECT key, value FROM problem")))
            if not connection.execute("SELECT COUNT(*) FROM planned").fetchone()[0]:
                raise StudyError("no simulation is planned, allowed: the store of a study with its design")
            connection.execute("PRAGMA journal_mode=WAL")  # last: it writes, and a file of something else is left alone
        except sqlite3.DatabaseError as error:
            connection.close()
            raise StudyError(
                f"{path}: cannot be used as the store of a sensitivity study ({error}), allowed: that of `gsa run`, "
                "where it may be written to and no other program locks it"
            ) from None
        except StudyError as error:
            connection.close()
            raise StudyError(f"{path}: {error}") from None
        return cls(path, connection, problem)

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        """Close the file; an error of SQLite, such as a full disk, becomes one that names the file."""
        self.close()
        if isinstance(error, sqlite3.Error):
            raise StudyError(f"{self.path}: {error}; what had finished before is stored") from None

    def extend(self, count: int) -> None:
        """Add training points to the design, all of them or, if this is interrupted, none; see `add_points`.

        Raises
        ------
        StudyError
            No positive number of points.
        """
        problem = self.problem
        extended = replace(problem, added=(*problem.added, count))
        with self._connection:
            self._connection.execute("BEGIN IMMEDIATE")  # no second extension between reading and writing
            planned = self._connection.execute("SELECT inputs FROM planned WHERE part = 'train' ORDER BY row")
            existing = np.array([self._numbers(inputs, len(problem.inputs)) for (inputs,) in planned])
            points = add_points(problem.inputs, existing, count, problem.seed, problem.design)
            _plan(self._connection, points, "train", f"added to {problem.design}", problem.seed)
            _write_parts(self._connection, extended)
        self.problem = extended

    def _take_over(self, problem: StudyProblem) -> None:
        """Replace the problem by one that differs in what has no bearing on simulations."""
        if problem != self.problem:
            with self._connection:
                _write_parts(self._connection, problem)
            self.problem = problem

    def pending(self, shard: Shard = WHOLE) -> list[tuple[int, dict[str, float]]]:
        """Row and inputs of every simulation of a part that has not ended, in order."""
        rows = self._connection.execute(
            "SELECT row, inputs FROM simulations WHERE status = 'pending' AND (row - ?) % ? = 0 ORDER BY row",
            (shard.index, shard.count),
        )
        count = len(self.problem.inputs)
        return [(row, self.problem.inputs.sample(self._numbers(inputs, count))) for row, inputs in rows]

    def record(self, outcome: Outcome) -> None:
        """Commit one finished simulation."""
        with self._connection:
            self._connection.execute(_END, self._ended(outcome))

    def _ended(self, outcome: Outcome) -> tuple[str, str | None, str | None, float, int]:
        """Return what `_END` stores of an outcome."""
        if outcome.outputs is None:
            return "failed", None, outcome.reason, outcome.seconds, outcome.row
        outputs = json.dumps([outcome.outputs[name] for name in self.problem.outputs])
        return "ok", outputs, outcome.reason, outcome.seconds, outcome.row

    def ended_rows(self) -> dict[int, EndedRow]:
        """Every simulation that ended, by its row."""
        rows = self._connection.execute(
            "SELECT row, inputs, outputs, reason, seconds FROM simulations WHERE status <> 'pending' ORDER BY row"
        )
        names, found = self.problem.outputs, {}
        for row, inputs, outputs, reason, seconds in rows:
            values = None if outputs is None else dict(zip(names, self._numbers(outputs, len(names)), strict=True))
            found[row] = EndedRow(inputs, Outcome(row, values, reason, seconds))
        return found

    def take(self, ended: Mapping[int, EndedRow]) -> None:
        """Commit simulations that ended in other stores of the same problem, all of them or none.

        Raises
        ------
        StudyError
            One has other inputs there: its design was made by another version of a library.
        """
        planned = dict(self._connection.execute("SELECT row, inputs FROM simulations"))
        for row, one in ended.items():
            if planned.get(row) != one.inputs:
                raise StudyError(
                    f"{self.path}: simulation {row} has other inputs in a part, allowed: the same design "
                    "(the same versions of this program and of scipy)"
                )
        with self._connection:
            self._connection.executemany(_END, [self._ended(one.outcome) for one in ended.values()])

    def counts(self, shard: Shard = WHOLE) -> Counts:
        """How far the campaign is, or a part of it."""
        by_status = dict(
            self._connection.execute(
                "SELECT status, COUNT(*) FROM simulations WHERE (row - ?) % ? = 0 GROUP BY status",
                (shard.index, shard.count),
            )
        )
        return Counts(sum(by_status.values()), by_status.get("ok", 0), by_status.get("failed", 0))

    def results(self, part: DesignPart) -> tuple[Array, Array]:
        """Read inputs (n, d) and outputs (n, q) of the simulations that ended well, in the order of the design."""
        rows = self._connection.execute(
            "SELECT inputs, outputs FROM planned WHERE part = ? AND status = 'ok' ORDER BY row", (part,)
        ).fetchall()
        d, q = len(self.problem.inputs), len(self.problem.outputs)
        X = np.array([self._numbers(inputs, d) for inputs, _ in rows]).reshape(len(rows), d)
        Y = np.array([self._numbers(outputs, q) for _, outputs in rows]).reshape(len(rows), q)
        return X, Y

    def rows(self, part: DesignPart) -> Integers:
        """Numbers of the simulations of `results`, (n,), from 1."""
        query = "SELECT row FROM planned WHERE part = ? AND status = 'ok' ORDER BY row"
        return np.array(self._connection.execute(query, (part,)).fetchall(), dtype=np.int64).reshape(-1)

    def realisations(self, part: DesignPart) -> Integers | None:
        """Realisation of the loads of each row of `results` (n,); None where all simulations share one."""
        return self.problem.realisations_of_rows()[self.rows(part) - 1] if self.problem.realisations else None

    def ended(self) -> tuple[Array, NDArray[np.bool_]]:
        """Read the inputs (n, d) of all simulations that ended, in order, and which of them failed (n,)."""
        rows = self._connection.execute(
            "SELECT inputs, status FROM simulations WHERE status <> 'pending' ORDER BY row"
        ).fetchall()
        d = len(self.problem.inputs)
        points = np.array([self._numbers(inputs, d) for inputs, _ in rows]).reshape(len(rows), d)
        return points, np.array([status == "failed" for _, status in rows], dtype=np.bool_)

    def _numbers(self, text: str, count: int) -> list[float]:
        """Read the inputs or outputs of a simulation."""
        numbers = validated(_NUMBERS, text, f"{self.path}: a simulation is not one of this study", StudyError)
        if len(numbers) != count:
            raise StudyError(f"{self.path}: a simulation of {len(numbers)} numbers, allowed: {count}")
        return numbers

    def failures(self) -> list[tuple[int, str]]:
        """Row and reason of every failed simulation."""
        rows = self._connection.execute("SELECT row, reason FROM simulations WHERE status = 'failed' ORDER BY row")
        return [(row, shortened(str(reason))) for row, reason in rows]

    def simulation_seconds(self) -> float:
        """Processor time that all simulations took together, s."""
        total = self._connection.execute("SELECT TOTAL(seconds) FROM simulations").fetchone()[0]
        return float(total)


def _connect(path: Path) -> sqlite3.Connection:
    """Connect to a file, waiting for another reader or writer for up to 30 s."""
    return sqlite3.connect(path, timeout=30.0)


def _write_problem(connection: sqlite3.Connection, problem: StudyProblem) -> None:
    """Write schema, problem and design of a new store."""
    design = make_design(problem.inputs, problem.train, problem.test, problem.seed, problem.design)
    connection.executescript(SCHEMA)
    with connection:
        _write_parts(connection, problem)
        _plan(connection, design.train, "train", problem.design, problem.seed)
        if len(design.test):
            _plan(connection, design.test, "test", TEST_DESIGN, problem.seed)


def _write_parts(connection: sqlite3.Connection, problem: StudyProblem) -> None:
    """Write the parts of a problem over those that are there."""
    connection.executemany("REPLACE INTO problem VALUES (?, ?)", problem.to_json().items())


def _plan(connection: sqlite3.Connection, points: Array, part: DesignPart, kind: str, seed: int) -> None:
    """Plan the simulations of a design; JSON keeps every bit of a float."""
    design = connection.execute("INSERT INTO designs (part, kind, seed) VALUES (?, ?, ?)", (part, kind, seed)).lastrowid
    connection.executemany(
        "INSERT INTO simulations (design, inputs) VALUES (?, ?)",
        ((design, json.dumps(point)) for point in points.tolist()),
    )
