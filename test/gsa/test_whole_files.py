"""Files that are there whole or not at all, and never through a link that somebody has put in their way."""

import os
import secrets

import pytest
import yaml
from campaign_problem import PROBLEM

from tbm_gsa.sensitivity.study.store import Store
from tbm_msgs_py import BagWriter
from tbm_msgs_py.bags import metadata
from tbm_msgs_py.base.files import write_json, write_whole


def write_store(path):
    Store.create_or_open(path, PROBLEM).close()


def write_bare(path):
    with BagWriter(path) as writer:
        writer.write("/a", "std_msgs/msg/String", 1, b"\0\1\0\0\1\0\0\0\0")


# Each with the name of what it writes, and the begin of the name that this has before it is whole.
WRITERS = {
    "whole": (lambda path: write_whole(path, b"new"), "a.html", "."),
    "json": (lambda path: write_json(path, {"a": 1}), "a.json", "."),
    "metadata": (lambda path: metadata.write(path.parent, {"a": 1}), "metadata.yaml", "."),
    "store": (write_store, "store.sqlite", "."),
    "recording": (write_bare, "a.mcap", f".a.{os.getpid()}."),
}


@pytest.fixture
def secret(tmp_path):
    """What nobody may write to: a file of somebody else."""
    path = tmp_path / "secret"
    path.write_text("theirs")
    yield path
    assert path.read_text() == "theirs"


@pytest.mark.parametrize("name", WRITERS)
def test_nothing_is_written_through_a_link(tmp_path, monkeypatch, secret, name):
    """Not even by one who could guess the name that the file has before it is whole."""
    write, file, label = WRITERS[name]
    folder = tmp_path / "results"
    folder.mkdir()
    monkeypatch.setattr(secrets, "token_hex", lambda _: "guessed")
    trap = folder / f"{label}guessed{(folder / file).suffix}"
    trap.symlink_to(secret)
    with pytest.raises((OSError, ValueError), match="exists"):
        write(folder / file)
    assert list(folder.iterdir()) == [trap]


@pytest.mark.parametrize("name", ["whole", "json", "metadata"])
def test_a_link_in_the_place_of_a_result_is_replaced(tmp_path, secret, name):
    write, file, _ = WRITERS[name]
    (tmp_path / file).symlink_to(secret)
    write(tmp_path / file)
    assert not (tmp_path / file).is_symlink()
    assert yaml.safe_load((tmp_path / file).read_text())
    assert sorted(tmp_path.iterdir()) == sorted([secret, tmp_path / file])


def test_who_may_read_a_result_is_as_of_any_new_file(tmp_path):
    write_whole(tmp_path / "result", b"")
    (tmp_path / "other").touch()
    assert (tmp_path / "result").stat().st_mode == (tmp_path / "other").stat().st_mode
