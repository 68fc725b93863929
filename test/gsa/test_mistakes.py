"""The likely mistakes of a new user: what the command line says, in one line that tells what to do."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tbm_gsa.app.cli.demo import DemoResult, print_tables
from tbm_gsa.app.cli.main import main
from tbm_gsa.app.cli.shipped import recording_path, shipped_bag
from tbm_msgs_py.bags.metadata import is_synthetic

SENSOR = "topics:\n  /rig: {point: girder, gravity: removed, frame: fixed, %s}\n"
MISTAKES = {
    "a command misspelt": (["simulte"], "No such command 'simulte'. Did you mean 'simulate'?"),
    "no such recording": (
        ["compare", "nowhere"],
        "HERE/nowhere: no such file or folder, allowed: a rosbag2 folder, or a .mcap or .db3 file, "
        "either of them as it is or .zstd",
    ),
    "a table for a recording": (
        ["compare", "run.csv"],
        "HERE/run.csv: not an MCAP file, its first bytes are not the MCAP magic, allowed: a recording; "
        "`tbm-monitor bag import` makes one of tables of other systems",
    ),
    "a recording in a database that is none": (
        ["bag", "info", "old"],
        "HERE/old/old_0.db3: SQLite: file is not a database, allowed: a database that rosbag2 wrote",
    ),
    "a topic that was not recorded": (
        ["bag", "play", "field_dz101", "--topics", "/tbm/operating_point,model/shield/block"],
        f"--topics model/shield/block: not in {shipped_bag()}, allowed: /tbm/field/cutterhead/block, "
        "/tbm/field/girder/block, /tbm/field/gripper/block, /tbm/field/shield/block, /tbm/field/walkway/block, "
        "/tbm/operating_point",
    ),
    "a unit not stated": (
        ["compare", "field_dz101", "--mapping", "none.yaml"],
        "none.yaml: topics./rig.units: missing, allowed: a value that is stated",
    ),
    "a key misspelt in a mapping": (
        ["compare", "field_dz101", "--mapping", "unit.yaml"],
        "unit.yaml: topics./rig.unit: unknown key, allowed: point, units, gravity, frame, axes, rotation, range, "
        "noise_density, resolution, band_hz, offset, frame_id",
    ),
    "no such machine": (
        ["simulate", "--machine", "dz102"],
        "dz102: no such machine; shipped are dz101, open380, or give the path of a YAML file",
    ),
    "an import without a description": (
        ["bag", "import", "run.csv", "--out", "new"],
        "import description: points, operating_point or drives: missing, allowed: at least one of them, in the file "
        "of --map or as --map POINT=X,Y,Z",
    ),
    "a recording to explain": (
        ["gsa", "explain", "old"],
        "old: Is a directory, allowed: what `tbm-monitor compare BAG --json` prints",
    ),
    "a page into no folder": (
        ["compare", "field_dz101", "--html", "no/out.html"],
        "no/out.html: no folder no, allowed: a file in a folder that is there",
    ),
    "a history that is not there": (
        ["history", "--history", "none.sqlite"],
        "none.sqlite: no such history; `compare` and the analysis node write one",
    ),
    "a study that is not there": (
        ["gsa", "resume", "--out", "new"],
        "new/store.sqlite: no such store, allowed: the folder of a study that was begun",
    ),
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "run.csv").write_text("t,a,b,c\n0,1,2,3\n")
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "old_0.db3").write_bytes(b"SQLite format 3\0")
    (tmp_path / "none.yaml").write_text(SENSOR % "range: 3")
    (tmp_path / "unit.yaml").write_text(SENSOR % "unit: g")
    monkeypatch.chdir(tmp_path)
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    yield tmp_path
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_told_in_one_line(name, folder, monkeypatch, capsys):
    given, said = MISTAKES[name]
    monkeypatch.setattr(sys, "argv", ["tbm-monitor", *given])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert capsys.readouterr() == ("", f"tbm-monitor: {said.replace('HERE', str(folder))}\n")


def test_the_shipped_recording_goes_by_its_name(folder):
    name = Path("field_dz101")
    assert recording_path(name) == shipped_bag()
    (folder / name).mkdir()
    assert recording_path(name) == folder / name  # what is there goes first


def test_the_demo_calls_only_the_shipped_recording_synthetic(folder, capsys):
    (folder / "link").symlink_to(shipped_bag())
    found = DemoResult.model_construct(points={}, outputs={}, blocks={}, findings=(), report="report.html", seconds=1.0)
    for path, synthetic in ((shipped_bag(), True), (Path("link"), True), (Path("old"), False), (Path("none"), False)):
        assert is_synthetic(path) is synthetic
        print_tables(found, synthetic=is_synthetic(path))
        assert ("synthetic" in capsys.readouterr().out) is synthetic


def test_a_reader_that_has_seen_enough_is_no_error(folder):
    line = f"{sys.executable} -m tbm_gsa.app.cli.main bag info field_dz101 | true; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("0\n", "")
