"""The schema of the history file: what a new one holds, how an older one is brought up to date, what can be wrong."""

import sqlite3
import time
from pathlib import Path
from typing import Final

from tbm_gsa.history.context import FARTHEST
from tbm_gsa.history.entries import AXES, SOURCE_KINDS, STATE_PARTS
from tbm_gsa.history.events import EVENT_KINDS, EVENT_VERDICTS, SEVERITIES
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.texts import LONGEST_LINE

LONGEST_PATH: Final = 4096
LOOK_S: Final = 0.01
"""Between two looks at a file that another program holds."""
LOCKED: Final = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
NO_ACCESS: Final = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY)


class HistoryError(InputError):
    """A file that is no history, or one that cannot be used; one line."""


class HistoryLockedError(HistoryError):
    """A history that another program holds locked; it may be tried again."""


def primary_code(error: sqlite3.Error) -> int:
    """SQLite's code of an error; 0 where it gave none."""
    return int(getattr(error, "sqlite_errorcode", 0)) & 0xFF


def unusable(path: Path, error: sqlite3.Error) -> HistoryError:
    """Error of a file that SQLite refuses to write, or that is no history."""
    code = primary_code(error)
    if code in LOCKED:
        return HistoryLockedError(f"{path}: {error}")
    if code in NO_ACCESS:
        return HistoryError(f"{path}: {error}, allowed: a file, in a folder, that may be written")
    return HistoryError(f"{path}: not a history of tbm_monitor that can be used ({error})")


SCHEMA_VERSION: Final = 7
APPLICATION_ID: Final = 0x54424D48  # "TBMH"
_BASELINES: Final = """
CREATE TABLE baselines (
    name TEXT NOT NULL,
    machine TEXT NOT NULL,
    machine_sha256 TEXT NOT NULL,
    created_ns INTEGER NOT NULL,
    since_ns INTEGER NOT NULL,
    until_ns INTEGER NOT NULL,
    {kind}
    PRIMARY KEY (machine, name)
) WITHOUT ROWID;
"""
_USUAL_ERRORS: Final = """
CREATE TABLE usual_errors (
    machine TEXT NOT NULL,
    baseline TEXT NOT NULL,
    point TEXT NOT NULL,
    axis TEXT NOT NULL,
    mean REAL NOT NULL,
    scatter REAL NOT NULL,
    windows INTEGER NOT NULL,
    {logs}
    PRIMARY KEY (machine, baseline, point, axis),
    FOREIGN KEY (machine, baseline) REFERENCES baselines (machine, name) ON DELETE CASCADE
) WITHOUT ROWID;
"""
_SOURCES: Final = """(
    id INTEGER PRIMARY KEY,
    kind TEXT NOT NULL CHECK (kind IN ('live', 'replay', 'offline', 'synthetic')),
    name TEXT NOT NULL,
    digest TEXT NOT NULL,
    machine TEXT NOT NULL,
    machine_sha256 TEXT NOT NULL,
    UNIQUE (kind, name, digest, machine, machine_sha256)
);
"""
# Rock and machine: at each level of operation a watch, the band powers that it is resumed from, and what it said.
_WATCHES: Final = """
CREATE TABLE watches (
    id INTEGER PRIMARY KEY,
    kind TEXT NOT NULL,
    node TEXT NOT NULL,
    machine TEXT NOT NULL,
    machine_sha256 TEXT NOT NULL,
    baseline TEXT NOT NULL,
    speed REAL NOT NULL,
    torque REAL NOT NULL,
    thrust REAL NOT NULL,
    reading TEXT NOT NULL
);
CREATE TABLE spans (
    watch INTEGER NOT NULL REFERENCES watches (id) ON DELETE CASCADE,
    start_ns INTEGER NOT NULL,
    log_powers BLOB NOT NULL,
    PRIMARY KEY (watch, start_ns)
) WITHOUT ROWID;
CREATE TABLE states (
    watch INTEGER NOT NULL REFERENCES watches (id) ON DELETE CASCADE,
    start_ns INTEGER NOT NULL,
    part TEXT NOT NULL,
    name TEXT NOT NULL,
    value REAL,
    low REAL,
    high REAL,
    probability REAL,
    since_ns INTEGER,
    text TEXT NOT NULL,
    PRIMARY KEY (watch, start_ns, part, name)
) WITHOUT ROWID;
"""
# What the site says of a time holds from a window of a source on, until a later row of it.
_EVENTS: Final = """
CREATE TABLE contexts (
    source INTEGER NOT NULL REFERENCES sources (id),
    since_ns INTEGER NOT NULL,
    ring INTEGER,
    chainage REAL,
    rock_class TEXT,
    shift TEXT,
    PRIMARY KEY (source, since_ns)
) WITHOUT ROWID;
CREATE TABLE events (
    number INTEGER PRIMARY KEY,
    source INTEGER NOT NULL REFERENCES sources (id),
    begin_ns INTEGER NOT NULL,
    event TEXT NOT NULL,
    point TEXT NOT NULL,
    severity TEXT NOT NULL,
    verdict TEXT NOT NULL,
    text TEXT NOT NULL,
    level TEXT NOT NULL,
    end_ns INTEGER,
    snapshot TEXT NOT NULL,
    ring INTEGER,
    chainage REAL,
    rock_class TEXT,
    shift TEXT,
    acknowledged_by TEXT NOT NULL DEFAULT '',
    acknowledged_ns INTEGER,
    comment TEXT NOT NULL DEFAULT '',
    UNIQUE (source, begin_ns, event, point, level)
);
CREATE INDEX events_by_time ON events (begin_ns);
"""
_SCHEMA: Final = f"""
CREATE TABLE sources {_SOURCES}
CREATE TABLE windows (
    source INTEGER NOT NULL REFERENCES sources (id),
    point TEXT NOT NULL,
    axis TEXT NOT NULL,
    start_ns INTEGER NOT NULL,
    length_ns INTEGER NOT NULL,
    field_rms REAL,
    model_rms REAL,
    relative_error REAL,
    coverage REAL NOT NULL,
    field_peak REAL,
    field_kurtosis REAL,
    PRIMARY KEY (start_ns, source, point, axis, length_ns)
) WITHOUT ROWID;
{_BASELINES.format(kind="kind TEXT,")}
{_USUAL_ERRORS.format(logs="log_mean REAL, log_scatter REAL,")}
{_WATCHES}
{_EVENTS}
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {SCHEMA_VERSION};
"""
_UPDATES: Final = {  # from the version to the next one
    1: """
ALTER TABLE windows ADD COLUMN field_peak REAL;
ALTER TABLE windows ADD COLUMN field_kurtosis REAL;
PRAGMA user_version = 2;
""",
    2: f"""
ALTER TABLE usual_errors RENAME TO old_errors;
ALTER TABLE baselines RENAME TO old_baselines;
{_BASELINES.format(kind="")}
{_USUAL_ERRORS.format(logs="")}
INSERT INTO baselines SELECT * FROM old_baselines;
INSERT INTO usual_errors
    SELECT machine, baseline, point, axis, mean, scatter, windows FROM old_errors JOIN old_baselines ON baseline = name;
DROP TABLE old_errors;
DROP TABLE old_baselines;
PRAGMA user_version = 3;
""",  # noqa: S608
    # A table whose check changes is made anew; its rows keep the numbers that the windows refer to.
    3: f"""
ALTER TABLE baselines ADD COLUMN kind TEXT;
CREATE TABLE new_sources {_SOURCES}
INSERT INTO new_sources SELECT * FROM sources;
DROP TABLE sources;
ALTER TABLE new_sources RENAME TO sources;
PRAGMA user_version = 4;
""",  # noqa: S608
    4: """
ALTER TABLE usual_errors ADD COLUMN log_mean REAL;
ALTER TABLE usual_errors ADD COLUMN log_scatter REAL;
PRAGMA user_version = 5;
""",
    5: f"""
{_WATCHES}
PRAGMA user_version = 6;
""",
    6: f"""
{_EVENTS}
PRAGMA user_version = 7;
""",
}


def version_of(path: Path, connection: sqlite3.Connection) -> int:
    """Version of the history in a database; 0 of an empty one.

    Raises
    ------
    HistoryError
        A database of something else, or of a newer version.
    """
    application, version = _pragma(connection, "application_id"), _pragma(connection, "user_version")
    if application == 0 and connection.execute("SELECT COUNT(*) FROM sqlite_master").fetchone()[0] == 0:
        return 0
    if application != APPLICATION_ID:
        raise HistoryError(f"{path}: a database of something else, allowed: a history of tbm_monitor")
    if not 1 <= version <= SCHEMA_VERSION:
        raise HistoryError(f"{path}: schema version {version}, allowed: 1 to {SCHEMA_VERSION}")
    return version


def bring_up_to_date(version: int, connection: sqlite3.Connection) -> None:
    """Write the schema into an empty database, or change an older one, within the transaction that is open."""
    if version == 0:
        _run(_SCHEMA, connection)
        return
    for older in range(version, SCHEMA_VERSION):
        _run(_UPDATES[older], connection)


def write_ahead(connection: sqlite3.Connection, wait_s: float) -> None:
    """Let readers go on while one writes; SQLite itself does not wait for another writer here."""
    deadline = time.monotonic() + wait_s
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
        except sqlite3.OperationalError as error:
            if primary_code(error) not in LOCKED or time.monotonic() > deadline:
                raise
            time.sleep(LOOK_S)
        else:
            return


def _run(script: str, connection: sqlite3.Connection) -> None:
    """Run statements within the transaction that is open; `executescript` would commit it first."""
    for statement in filter(str.strip, script.split(";")):
        connection.execute(statement)


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    return int(connection.execute(f"PRAGMA {name}").fetchone()[0])


def _texts(*names: str) -> str:
    return " AND ".join(f"typeof({name}) = 'text' AND length({name}) <= {LONGEST_LINE}" for name in names)


def _whole(*names: str) -> str:
    """Whole numbers, of which the sum of two is still one."""
    return " AND ".join(f"typeof({name}) = 'integer' AND {name} BETWEEN -{2**62} AND {2**62}" for name in names)


def _numbers(*names: str) -> str:
    """Numbers; NULL are those that are not known."""
    return " AND ".join(f"typeof({name}) IN ('real', 'null')" for name in names)


def _maybe(condition: str, *names: str) -> str:
    """NULL, or what a condition with a place for the name says."""
    return " AND ".join(f"({name} IS NULL OR {condition.format(name=name)})" for name in names)


_AXIS: Final = f"axis IN {AXES}"
# What rows of a history this program writes, as conditions in SQL: SQLite itself takes any type anywhere.
_SOURCE: Final = f"kind IN {SOURCE_KINDS} AND {_texts('name', 'digest', 'machine', 'machine_sha256')}"
WINDOW_IS_SOUND: Final = " AND ".join(
    (
        _SOURCE,
        _texts("point"),
        _AXIS,
        _whole("start_ns", "length_ns"),
        _numbers("field_rms", "model_rms", "relative_error", "coverage", "field_peak", "field_kurtosis"),
    )
)
BASELINE_IS_SOUND: Final = " AND ".join(
    (
        _texts("name", "machine", "machine_sha256"),
        _whole("created_ns", "since_ns", "until_ns"),
        f"(kind IS NULL OR kind IN {SOURCE_KINDS})",
    )
)
WATCH_IS_SOUND: Final = " AND ".join(
    (
        f"kind IN {SOURCE_KINDS}",
        _texts("node", "machine", "machine_sha256", "baseline"),
        "typeof(reading) = 'text'",
        *(f"typeof({name}) = 'real'" for name in ("speed", "torque", "thrust")),
    )
)
STATE_IS_SOUND: Final = " AND ".join(
    (
        f"part IN {STATE_PARTS}",
        _texts("name", "text"),
        _whole("start_ns"),
        _numbers("value", "low", "high", "probability"),
        _maybe(_whole("{name}"), "since_ns"),
    )
)
USUAL_ERROR_IS_SOUND: Final = " AND ".join(
    (_texts("point"), _AXIS, _numbers("mean", "scatter", "log_mean", "log_scatter"), _whole("windows"))
)
CONTEXT_IS_SOUND: Final = " AND ".join(
    (
        _maybe(_whole("{name}"), "ring"),
        _maybe(f"typeof({{name}}) = 'real' AND abs({{name}}) <= {FARTHEST}", "chainage"),
        _maybe(_texts("{name}"), "rock_class", "shift"),
    )
)
EVENT_IS_SOUND: Final = " AND ".join(
    (
        _SOURCE,
        f"event IN {EVENT_KINDS}",
        f"severity IN {SEVERITIES}",
        f"verdict IN {EVENT_VERDICTS}",
        _texts("point", "text", "level", "acknowledged_by", "comment"),
        f"typeof(snapshot) = 'text' AND length(snapshot) <= {LONGEST_PATH}",
        _whole("number", "begin_ns"),
        _maybe(_whole("{name}"), "end_ns", "acknowledged_ns"),
        CONTEXT_IS_SOUND,
    )
)
