"""The distributions: they build from one another, hold every file, and run where they are installed."""

import ast
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("tbm_dynamics", "tbm_gsa", "tbm_msgs_py")
SHARE = ("launch", "config", "bags/field_dz101")
LEFT = shutil.ignore_patterns(".*", "build", "dist", "*.egg-info", "__pycache__", "tbm_demo", "tbm_run", "out")


def files_under(folder):
    return sorted(
        str(path.relative_to(ROOT))
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    )


@pytest.fixture(scope="module")
def distributions(tmp_path_factory):
    """The sdist of a copy of the sources, and the wheel built from that sdist."""
    folder = tmp_path_factory.mktemp("distributions")
    shutil.copytree(ROOT, folder / "source", ignore=LEFT)
    done = subprocess.run(
        [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(folder / "source")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (sdist,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    return sdist, wheel


def test_the_wheel_holds_every_file(distributions):
    _, wheel = distributions
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    stem = "-".join(wheel.name.split("-")[:2])
    share = f"{stem}.data/data/share/"
    for package in PACKAGES:
        assert f"{package}/py.typed" in names
        assert set(files_under(package)) <= names
    for folder in SHARE:
        assert {f"{share}tbm_monitor/{name}" for name in files_under(folder)} <= names
    assert f"{share}tbm_monitor/package.xml" in names
    assert f"{share}ament_index/resource_index/packages/tbm_monitor" in names
    assert any(re.fullmatch(rf"{re.escape(stem)}\.dist-info/(licenses/)?LICENSE", name) for name in names)
    assert not any(name.startswith(("test/", "benchmarks/", "docs/")) for name in names)


def test_the_sdist_holds_what_a_developer_needs(distributions):
    sdist, _ = distributions
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"LICENSE", "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "Makefile", "package.xml"} <= names
    for folder in (*PACKAGES, *SHARE, "docs/images", "test"):
        assert set(files_under(folder)) <= names


@pytest.fixture(scope="module")
def installed(distributions, tmp_path_factory):
    """Run an executable of a fresh environment outside the sources; what it needs comes from that of the tests."""
    folder = tmp_path_factory.mktemp("installed")
    venv.create(folder / "venv", with_pip=False)
    python = folder / "venv" / "bin" / "python"
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-deps", distributions[1]],
        check=True,
    )
    found = subprocess.run(
        [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
        capture_output=True,
        text=True,
        check=True,
    )
    # Behind what is installed: an editable install of the sources there does not come first.
    needed = sysconfig.get_path("purelib")
    (Path(found.stdout.strip()) / "needed.pth").write_text(f"import site; site.addsitedir({needed!r})\n")
    environment = {name: value for name, value in os.environ.items() if name not in {"PYTHONPATH", "PYTHONHOME"}}

    def run(executable, *arguments, compiled=False):
        # To compile what is new there takes longer than what these commands do of it.
        return subprocess.run(
            [folder / "venv" / "bin" / executable, *arguments],
            cwd=folder,
            env=environment if compiled else {**environment, "NUMBA_DISABLE_JIT": "1"},
            capture_output=True,
            text=True,
            check=False,
        )

    where = run("python", "-c", "import tbm_gsa; print(tbm_gsa.__file__)").stdout
    assert where.startswith(str(folder)), where
    return run


def test_it_runs_where_it_is_installed(installed):
    done = installed("tbm-monitor", "machine", "show", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["degrees_of_freedom"] == 420


def test_the_shipped_recording_is_found_where_it_is_installed(installed):
    done = installed("tbm-monitor", "bag", "info", "field_dz101", "--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["messages"] == 1485
    assert document["path"].endswith("venv/share/tbm_monitor/bags/field_dz101")


@pytest.mark.verify  # compiles everything anew
def test_doctor_finds_all_where_it_is_installed(installed):
    pytest.importorskip("rclpy")
    done = installed("tbm-monitor", "doctor", "--json", compiled=True)
    assert done.returncode == 0, done.stdout
    assert json.loads(done.stdout)["ok"] is True


def test_every_executable_is_there(installed):
    for name in ("load_node", "dynamics_node", "analysis_node", "bag_player", "bag_recorder", "live_view", "web_view"):
        found = installed(
            "python", "-c", f"import shutil, sys; print(shutil.which({name!r}, path=sys.prefix + '/bin'))"
        )
        assert found.stdout.strip().endswith(name)


def required():
    """What setup.py requires."""
    tree = ast.parse((ROOT / "setup.py").read_text())
    (stated,) = [s.value for s in tree.body if isinstance(s, ast.Assign) and s.targets[0].id == "REQUIRED"]
    return ast.literal_eval(stated)


def test_a_native_install_is_told_everything_that_setup_requires():
    page = (ROOT / "docs" / "howto" / "native.md").read_text(encoding="utf-8")
    command = re.search(r"^    pip install ((?:.*\\\n)*.*)", page, re.MULTILINE)[1]
    assert shlex.split(command.replace("\\\n", " ")) == required()


def test_package_xml_names_everything_that_setup_requires():
    text = (ROOT / "package.xml").read_text()
    keys = {key.text for key in ElementTree.fromstring(text).iter("exec_depend")}
    other = {"pyyaml": "python3-yaml", "scikit-learn": "python3-sklearn", "pillow": "python3-pil"}
    names = [re.match(r"[\w.-]+", requirement)[0] for requirement in required()]
    assert {name for name in names if other.get(name, f"python3-{name}") not in keys} == set(
        re.search(r"No rosdep key: (.*)\.\n", text)[1].split(", ")
    )


def test_there_is_one_version(installed):
    stated = ElementTree.parse(ROOT / "package.xml").findtext("version")
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)[1]
    printed = installed("tbm-monitor", "--version").stdout.split()
    assert printed == ["tbm-monitor", stated]
    assert newest == stated
    assert installed("python", "-c", "import tbm_gsa; print(tbm_gsa.__version__)").stdout.strip() == stated


def test_every_test_file_has_a_name_of_its_own():
    """Or `make verify`, which looks through all of them at once, could not begin."""
    names = [path.name for path in (ROOT / "test").rglob("*.py") if path.name != "conftest.py"]
    assert sorted(set(names)) == sorted(names)
