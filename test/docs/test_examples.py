"""The examples of the pages, run as they are written: a page's blocks in their order, in one folder."""

import os
import shlex
import shutil
import signal
import sys
from types import SimpleNamespace

import pytest
from pages import PAGES, ROOT, agrees, examples

from tbm_gsa.app.cli.main import main
from tbm_msgs_py import ACCELERATION
from tbm_msgs_py.blocks import encode

WITH_EXAMPLES = [
    page for page in PAGES if any(one.language == "python" or "run" in one.words for one in examples(page))
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Where a reader of the pages stands: `bags/` of the sources is there, and a recording of their own."""
    (tmp_path / "bags").symlink_to(ROOT / "bags")
    shutil.copy(ROOT / "bags" / "field_dz101" / "field_dz101.mcap", tmp_path / "field.mcap")
    shutil.copy(ROOT / "bags" / "field_dz101" / "field_dz101.mcap", tmp_path / "broken.mcap")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setenv("COLUMNS", "100")
    return tmp_path


@pytest.fixture
def command(monkeypatch, capsys):
    """Run a command line: exit code, stdout, stderr."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]

    def run(line):
        monkeypatch.setattr(sys, "argv", shlex.split(line))
        with pytest.raises(SystemExit) as end:
            main()
        return end.value.code, *capsys.readouterr()

    yield run
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


def _namespace():
    """What a page's Python may take for granted: a message that has arrived."""
    block = encode(ACCELERATION, [0.0, 0.1], [[1.0, 2.0, 3.0]] * 2)
    return {"message": SimpleNamespace(data=block)}


def run_page(page, command, *, dear):
    """Run what is marked on a page; `dear` blocks are those that take minutes."""
    namespace, ran = _namespace(), 0
    for example in examples(page):
        if ("verify" in example.words) and not dear:
            continue
        where = f"{page.relative_to(ROOT)}:{example.line}"
        if example.language == "python":
            exec(compile(example.text, where, "exec"), namespace)
            ran += 1
        elif "run" in example.words:
            for line, shown in example.commands():
                code, printed, said = command(line)
                assert code == 0, f"{where}: {line}\n{said}"
                assert not shown or agrees(shown, printed), f"{where}: {line} prints\n{printed}"
                ran += 1
    return ran


@pytest.mark.parametrize("page", WITH_EXAMPLES, ids=lambda page: str(page.relative_to(ROOT)))
def test_examples_of_a_page_run(page, folder, command):
    assert os.environ["XDG_DATA_HOME"] == str(folder / "data")
    assert run_page(page, command, dear=False)


@pytest.mark.verify
@pytest.mark.parametrize("page", [page for page in PAGES if any("verify" in one.words for one in examples(page))])
def test_dear_examples_of_a_page_run(page, folder, command):
    assert run_page(page, command, dear=True)
