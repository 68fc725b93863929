"""Texts of others on their way to a terminal: shown, never obeyed.

Control characters of ECMA-48 (C0 and C1), and those of Unicode that turn the direction of writing.
"""

import json
import sys

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import RootModel
from rich.table import Table
from rich.text import Text

from tbm_gsa.app.cli.main import main
from tbm_gsa.app.cli.output import notes, print_json, results
from tbm_msgs_py import BagWriter
from tbm_msgs_py.base.files import json_text
from tbm_msgs_py.base.texts import printable

CONTROLS = [*map(chr, range(0x20)), *map(chr, range(0x7F, 0xA0)), *"\u200e\u200f\u2028\u2029", *"\u061c"]
CONTROLS += [*map(chr, range(0x202A, 0x202F)), *map(chr, range(0x2066, 0x206A))]
HOSTILE = "\x1b]0;title\x07\x1b[2J\x9b31m\u202eright\x7f"


def controls(text):
    return set(text) & set(CONTROLS) - {"\n"}


@given(st.text())
@example("".join(CONTROLS))
def test_what_is_printable_stays_and_the_rest_is_shown(text):
    shown = printable(text)
    assert not set(shown) & set(CONTROLS)
    assert printable(shown) == shown
    assert (shown == text) == text.isprintable()


@given(st.dictionaries(st.text(), st.text()))
@example({"".join(CONTROLS): "".join(CONTROLS)})
def test_json_is_the_same_document_without_controls(document):
    text = json_text(document, indent=1)
    assert json.loads(text) == document
    assert not controls(text)


@pytest.mark.parametrize("control", CONTROLS, ids=ascii)
def test_no_control_reaches_a_terminal(control, capsys):
    text = f"a{control}b"
    table = Table(title=Text(text))
    table.add_column(text)
    table.add_row(text)
    for console in (results, notes):
        console.print(text)
        console.print(Text(text))
        console.print(table)
    print_json(RootModel({text: text}))
    caught = capsys.readouterr()
    assert not controls(caught.out + caught.err)


@pytest.mark.parametrize("control", sorted(set(CONTROLS) - set("\n\a\b\v\f\r")), ids=ascii)  # those rich leaves out
def test_what_is_shown_in_a_table_is_whole(control, capsys):
    table = Table("name")
    table.add_row(Text(f"a{control}b"))
    results.print(table)
    assert f" a{printable(control)}b " in capsys.readouterr().out


def test_names_in_a_recording_steer_no_terminal(tmp_path, monkeypatch, capsys):
    with BagWriter(tmp_path / HOSTILE.replace("/", "")) as writer:
        writer.write(f"/{HOSTILE}", f"std_msgs/msg/{HOSTILE}", 1, b"\0\1\0\0", definition=("string data", ""))
    for more in ([], ["--json"], ["--scan"]):
        monkeypatch.setattr(sys, "argv", ["tbm-monitor", "bag", "info", str(next(tmp_path.iterdir())), *more])
        with pytest.raises(SystemExit) as left:
            main()
        caught = capsys.readouterr()
        assert left.value.code == 0, caught.err
        assert not controls(caught.out + caught.err)
        assert "right" in caught.out


@pytest.mark.parametrize("command", [["bag", "info"], ["compare"], ["machine", "show"], ["simulate", "--schedule"]])
def test_a_refusal_steers_no_terminal(command, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["tbm-monitor", *command, f"/nowhere/{HOSTILE}"])
    with pytest.raises(SystemExit) as left:
        main()
    said = "".join(capsys.readouterr())
    assert left.value.code == 2
    assert not controls(said)
    assert r"\x1b" in said


def test_a_name_in_brackets_is_printed_as_it_is(capsys):
    notes.print("[/tbm] [bold]x[/bold] :smile:")
    assert capsys.readouterr().err == "[/tbm] [bold]x[/bold] :smile:\n"
