"""A history that is only read: that of another user, in a folder that takes no files, while its owner writes to it.

Owner and reader are two users where the tests run as root; elsewhere folder and file refuse to be written.
"""

import json
import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest

from tbm_gsa.history import History, HistoryEntry, HistoryError, HistoryLockedError, HistoryReader, WindowSource

START = 1_700_000_000_000_000_000
LENGTH = 2_000_000_000
LIVE = WindowSource("live", "/tbm/analysis_node", "", "dz101", "ab" * 32)
NOBODY = 65534

# Writes a window, then another one in a transaction that stays open; both reach the log beside the file only.
OWNER = """
import sqlite3, sys
connection = sqlite3.connect(sys.argv[1], isolation_level=None)
connection.execute("PRAGMA wal_autocheckpoint = 0")
later = "start_ns + 2000000000 * ?, length_ns, 1, 1, 0.5, 1, 1, 1"
row = f"INSERT INTO windows SELECT source, point, axis, {later} FROM windows LIMIT 1"
connection.execute(row, (1,))
connection.execute("BEGIN IMMEDIATE")
connection.execute(row, (2,))
print("written", flush=True)
sys.stdin.read()
"""


def entry(number):
    return HistoryEntry("shield", "x", START + number * LENGTH, LENGTH, 1.0, 1.2, 0.2, 1.0)


@pytest.fixture
def folder():
    """A folder that any user reaches, with a history of one window; `tmp_path` is its owner's alone."""
    path = Path(tempfile.mkdtemp(prefix="tbm_history_"))
    path.chmod(0o755)
    with History(path / "h.sqlite") as opened:
        opened.add(LIVE, [entry(0)])
    yield path
    path.chmod(0o755)
    shutil.rmtree(path)


@contextmanager
def stranger(folder):
    """Somebody who may read the files of a folder and write nothing."""
    modes = {path: path.stat().st_mode & 0o777 for path in (*folder.iterdir(), folder)}
    if os.geteuid() == 0:
        os.seteuid(NOBODY)
    else:
        for path, mode in modes.items():
            path.chmod(mode & 0o555)
    try:
        with pytest.raises(OSError, match="denied"):
            (folder / "mine").touch()
        yield
    finally:
        if os.getuid() == 0:
            os.seteuid(0)
        else:
            for path, mode in modes.items():
                path.chmod(mode)


@contextmanager
def owner(file):
    """Another process that has the history open and is in the middle of writing."""
    process = subprocess.Popen([sys.executable, "-c", OWNER, file], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout.readline() == b"written\n"
    yield process
    process.communicate()


def read(file):
    with HistoryReader(file) as opened:
        return [(window.entry.start_ns - START) // LENGTH for window in opened.windows()]


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_history_at_rest_is_read_and_nothing_made(folder):
    before = (folder / "h.sqlite").stat()
    with stranger(folder):
        assert read(folder / "h.sqlite") == [0]
    assert read(folder / "h.sqlite") == [0]  # its owner leaves nothing behind either
    assert names(folder) == ["h.sqlite"]
    after = (folder / "h.sqlite").stat()
    assert (after.st_mtime_ns, after.st_size) == (before.st_mtime_ns, before.st_size)


def test_a_history_is_read_while_its_owner_writes(folder):
    file = folder / "h.sqlite"
    with owner(file) as process:
        there = ["h.sqlite", "h.sqlite-shm", "h.sqlite-wal"]
        assert names(folder) == there
        with stranger(folder):
            assert read(file) == [0, 1]  # what is committed, though it is in the log only
        assert read(file) == [0, 1]
        assert names(folder) == there
        process.kill()
    assert names(folder) == there
    with stranger(folder):
        assert read(file) == [0, 1]
    with History(file) as opened:
        opened.add(LIVE, [entry(5)])
    assert read(file) == [0, 1, 5]


def test_a_log_without_its_index_is_one_line(folder):
    file = folder / "h.sqlite"
    with owner(file) as process:
        process.kill()
    (folder / "h.sqlite-shm").unlink()
    with stranger(folder), pytest.raises(HistoryError, match=r"written last is in h\.sqlite-wal and h\.sqlite-shm"):
        HistoryReader(file)
    assert names(folder) == ["h.sqlite", "h.sqlite-wal"]


def test_an_owner_who_comes_in_the_middle_is_noticed(folder):
    file = folder / "h.sqlite"
    opened = HistoryReader(file)
    assert opened.count() == 1
    with History(file) as other:
        other.add(LIVE, [entry(1)])
    with pytest.raises(HistoryLockedError, match=r"h\.sqlite: another program wrote to it meanwhile; try again"):
        opened.close()
    assert read(file) == [0, 1]


def test_a_locked_history_may_be_tried_again(folder):
    file = folder / "h.sqlite"
    with owner(file):
        pass
    other = sqlite3.connect(file, isolation_level=None)
    other.execute("PRAGMA locking_mode = EXCLUSIVE")
    other.execute("BEGIN EXCLUSIVE")
    script = f"from pathlib import Path; from tbm_gsa.history import *; HistoryReader(Path({str(file)!r}), wait_s=0.0)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    other.close()
    assert "HistoryLockedError" in done.stderr
    assert "database is locked" in done.stderr


def test_an_older_history_is_not_brought_up_to_date(folder):
    file = folder / "h.sqlite"
    with sqlite3.connect(file) as connection:
        connection.execute("PRAGMA user_version = 1")
    connection.close()
    content = file.read_bytes()
    with pytest.raises(HistoryError, match=r"schema version 1, allowed to read: \d; `compare` or the analysis node"):
        HistoryReader(file)
    assert file.read_bytes() == content
    assert names(folder) == ["h.sqlite"]


def test_what_cannot_be_read_is_one_line(folder):
    os.mkfifo(folder / "pipe.sqlite")
    for name in ("none.sqlite", "", "h.sqlite/h.sqlite", "pipe.sqlite"):
        with pytest.raises(HistoryError, match="no such history"):
            HistoryReader(folder / name)
    (folder / "pipe.sqlite").unlink()
    (folder / "empty.sqlite").touch()
    with pytest.raises(HistoryError, match="an empty file, no history yet"):
        HistoryReader(folder / "empty.sqlite")
    (folder / "text.sqlite").write_text("no database " * 100)
    with pytest.raises(HistoryError, match="not a history of tbm_monitor that can be used"):
        HistoryReader(folder / "text.sqlite")
    (folder / "secret.sqlite").touch(mode=0o000)
    with stranger(folder):
        with pytest.raises(HistoryError, match=r"secret\.sqlite: Permission denied, allowed: a file that may be read"):
            HistoryReader(folder / "secret.sqlite")
        with pytest.raises(HistoryError, match="a file, in a folder, that may be written"):
            History(folder / "h.sqlite", create=False)
    assert names(folder) == ["empty.sqlite", "h.sqlite", "secret.sqlite", "text.sqlite"]


@pytest.mark.parametrize("name", ["a b.sqlite", "50%_?mode=rwc#.sqlite", "ü.sqlite"])
def test_names_of_files_are_no_part_of_the_address(folder, name):
    (folder / "h.sqlite").rename(folder / name)
    assert read(folder / name) == [0]
    assert names(folder) == [name]


def test_a_stranger_lists_plots_and_sees_baselines(folder, typed, tmp_path):
    file = str(folder / "h.sqlite")
    with History(Path(file)) as opened:
        opened.add(LIVE, [entry(n) for n in range(1, 5)])

    def see(pages):
        pictures = ("--html", f"{pages}/h.html", "--png", f"{pages}/h.png")
        return {
            "list": typed("history", "--history", file, "--json", *pictures),
            "baselines": typed("history", "baseline", "list", "--history", file, "--json"),
            "baseline": typed("history", "baseline", "show", "spring", "--history", file, "--json"),
            "set": typed("history", "baseline", "set", "spring", "--history", file),
        }

    see(tmp_path)  # as the owner: what the commands import is loaded then, and `spring` is there
    with stranger(folder), tempfile.TemporaryDirectory() as pages:
        done = see(pages)
        assert names(Path(pages)) == ["h.html", "h.png"]
    assert [code for code, _, _ in done.values()] == [0, 0, 0, 2]
    assert json.loads(done["list"][1])["total"] == 5
    assert [one["name"] for one in json.loads(done["baselines"][1])["baselines"]] == ["spring"]
    assert json.loads(done["baseline"][1])["points"]["shield"]["x"]["windows"] == 5
    assert "that may be written" in done["set"][2]
    assert names(folder) == ["h.sqlite"]
