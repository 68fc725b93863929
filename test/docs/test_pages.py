"""What the pages name is there: commands, options, keys, files."""

import json
import re
import sys

import pytest
import typer
from pages import MADE, PAGES, ROOT, agrees, named_commands

from tbm_gsa.app.cli.main import app, main
from tbm_gsa.history import default_history

COMMAND_LINE = typer.main.get_command(app)
LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")


def options_of(line):
    """The command that a line names, and the options it gives."""
    command, words = COMMAND_LINE, line.split()[1:]
    while hasattr(command, "commands") and words and words[0] in command.commands:
        command, words = command.commands[words[0]], words[1:]
    return command, [word.split("=")[0] for word in words if word.startswith("--")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_and_options_exist(page):
    for line in named_commands(page):
        command, options = options_of(line)
        word = line.split()[1]
        # COMMAND stands for any; a group by itself is named too.
        assert command is not COMMAND_LINE or word in {"COMMAND", "--version", "--help"}, line
        known = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
        assert set(options) <= known | {"--help"}, line


def test_the_readme_names_every_command():
    named = {options_of(line)[0].name for line in named_commands(ROOT / "README.md")}
    missing = {"demo", "run", "simulate", "compare", "history", "explain", "update", "import", "record", "play"} - named
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists() or target.rpartition("/")[2] in MADE, target


def test_the_walks_name_the_files_that_there_are():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    files = {str(path.relative_to(ROOT).with_suffix("")) for path in ROOT.glob("tbm_*/**/*.py")}
    walks = re.findall(r"^\*\*[^*]+\*\* \((\d+) files\)\.(.*?)\n\n", text, re.MULTILINE | re.DOTALL)
    assert len(walks) == 3
    for stated, walk in walks:
        found = set()
        for step in walk.split("→"):
            folder = ""
            for name in re.findall(r"`([^`]+)`", step):
                if name.endswith("/"):
                    folder = name
                else:  # of several, that on the lowest floor
                    ends = f"/{folder}{name}"
                    found.add(min((file for file in files if file.endswith(ends)), key=len, default=f"no {ends}"))
        assert not [name for name in found if name.startswith("no ")]
        assert len(found) == int(stated), sorted(found)


def test_the_page_of_operation_names_the_services_history(monkeypatch):
    unit = (ROOT / "config" / "tbm_monitor.service").read_text(encoding="utf-8")
    # systemd.unit(5): %S is /var/lib for the services of the system.
    monkeypatch.setenv("XDG_DATA_HOME", re.search(r"XDG_DATA_HOME=(\S+)", unit)[1].replace("%S", "/var/lib"))
    monkeypatch.delenv("TBM_HISTORY", raising=False)
    assert f"`{default_history()}`" in (ROOT / "docs" / "operation.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "given",
    [
        "simulate --duration 0.05",
        "machine check --machine open380",
        "machine show --machine open380",
        "machine loads --machine open380 --duration 20",
        "bag info {bag}",
        "bag info {bag} --scan",
    ],
)
def test_keys_of_documents_are_described(given, monkeypatch, capsys):
    monkeypatch.setattr(
        sys, "argv", ["tbm-monitor", *given.format(bag=ROOT / "bags" / "field_dz101").split(), "--json"]
    )
    with pytest.raises(SystemExit):
        main()
    document = json.loads(capsys.readouterr().out)
    text = (ROOT / "docs" / "reference" / "json.md").read_text(encoding="utf-8")
    section = re.search(rf"^## {given.split()[0]}\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)[1]
    described = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]*)`", section))))
    assert set(document) <= described


def with_json(group=COMMAND_LINE, names=()):
    """Names of every command that prints a document."""
    for name, command in getattr(group, "commands", {}).items():
        if any("--json" in parameter.opts for parameter in command.params):
            yield *names, name
        yield from with_json(command, (*names, name))


def test_every_document_has_its_place():
    text = (ROOT / "docs" / "reference" / "json.md").read_text(encoding="utf-8")
    sections = {part.splitlines()[0]: part for part in re.split(r"^## ", text, flags=re.MULTILINE)[1:]}
    found = list(with_json())
    assert {("reproduce",), ("gsa", "report")} <= set(found)
    for first, *rest in found:
        assert first in sections
        assert all(re.search(rf"`(\w+ )?{name}`", sections[first]) for name in rest), (first, *rest)


@pytest.mark.parametrize(
    ("shown", "printed", "expected"),
    [
        ("ok  1.00 g", "ok 1.01 g\n", True),
        ("ok 1.00 g", "ok 1.20 g", False),
        ("after ... s", "after 17.3 s", True),
        ("a b", "a c", False),
        ("a", "a b", False),
    ],
)
def test_what_counts_as_printed_alike(shown, printed, expected):
    assert agrees(shown, printed) is expected


def test_every_file_with_verifications_says_why():
    text = (ROOT / "docs" / "verification.md").read_text(encoding="utf-8")
    marked = {file.name for file in (ROOT / "test").rglob("test_*.py") if "mark.verify" in file.read_text("utf-8")}
    assert set(re.findall(r"^\| `(\w+\.py)`", text, re.MULTILINE)) == marked - {"test_pages.py"}


def test_every_document_has_a_schema(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "extensions"))
    from generated_pages import RESULTS

    same = {"gsa resume", "gsa extend", "gsa report", "history baseline set", "history baseline delete"}
    assert {" ".join(names) for names in with_json()} == {*RESULTS, *same} - {"bag info --scan"}
