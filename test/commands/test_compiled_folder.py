"""Compiled code where neither the packages nor the home folder can be written, as in a container of an unknown user."""

import os
import shutil
import subprocess
import sys

import pytest

from tbm_gsa.compiled import COMPILED

PACKAGES = ("tbm_dynamics", "tbm_gsa", "tbm_msgs_py")
NOWHERE = "/proc"  # where nobody can make a folder, root neither


@pytest.fixture(scope="module")
def installed(request, tmp_path_factory):
    """Packages beside whose modules nothing can be kept, for root neither: a file has the name of the folder."""
    folder = tmp_path_factory.mktemp("installed")
    for package in PACKAGES:
        copied = shutil.copytree(
            request.config.rootpath / package, folder / package, ignore=shutil.ignore_patterns("__pycache__")
        )
        for place in [copied, *(path for path in copied.rglob("*") if path.is_dir())]:
            (place / "__pycache__").write_text("")
    return folder


@pytest.fixture
def run(installed, tmp_path):
    """Run a module: exit code, stdout, stderr."""

    def call(*given, **more):
        names = {"HOME": NOWHERE, "PYTHONPATH": str(installed), "TMPDIR": str(tmp_path), "PATH": os.environ["PATH"]}
        done = subprocess.run(
            [sys.executable, "-m", *given], cwd="/", env=names | more, capture_output=True, text=True, check=False
        )
        return done.returncode, done.stdout, done.stderr

    return call


LIST = ("tbm_gsa.app.cli.main", "machine", "list")


def test_numba_alone_finds_no_place_there(run):
    code, _, err = run("tbm_dynamics.integration.laws")
    assert code == 1
    assert "no locator available" in err


def test_a_command_makes_a_private_folder_and_says_so(run, tmp_path):
    for _ in range(2):  # the second finds it
        code, out, err = run(*LIST)
        (made,) = tmp_path.iterdir()
        assert (code, out) == (0, "dz101\nopen380\n"), err
        assert err == (
            f"compiled code is kept in {made}, for no other folder can be written; NUMBA_CACHE_DIR names one\n"
        )
        assert made.stat().st_mode & 0o777 == 0o700


def test_a_node_makes_it_too(run, tmp_path):
    code, _, err = run("tbm_gsa.app.nodes.start", "tbm_dynamics.integration.laws")
    assert "no locator available" not in err
    assert err.startswith(f"compiled code is kept in {tmp_path}/")
    assert code == 1  # that module is none of a node
    assert "has no attribute 'main'" in err


@pytest.mark.parametrize("problem", ["a file is there", "others may write"])
def test_a_folder_that_is_not_private_is_refused(run, tmp_path, problem):
    folder = tmp_path / f"tbm_monitor_compiled_{os.getuid()}"
    if problem == "a file is there":
        folder.write_text("x")
    else:
        folder.mkdir()
        folder.chmod(0o777)
    code, out, err = run(*LIST)
    assert (code, out, len(err.splitlines())) == (2, "", 1), err
    assert "NUMBA_CACHE_DIR names one" in err


def test_a_folder_that_is_named_is_taken_without_a_word(run, tmp_path):
    assert run(*LIST, NUMBA_CACHE_DIR=str(tmp_path / "named")) == (0, "dz101\nopen380\n", "")
    assert [path.name for path in tmp_path.iterdir()] == ["named"]


def test_every_folder_with_compiled_code_is_looked_at(request):
    root = request.config.rootpath
    modules = [file for package in PACKAGES for file in (root / package).rglob("*.py")]
    compiled = {str(file.parent.relative_to(root)) for file in modules if "njit(" in file.read_text("utf-8")}
    assert compiled == set(COMPILED)
