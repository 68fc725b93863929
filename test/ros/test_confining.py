"""Where nodes write: what is set over ROS, by whoever reaches the domain, makes files below the root only."""

import pytest

rclpy = pytest.importorskip("rclpy")

from tbm_gsa.app.nodes.analysis_node import AnalysisNode  # noqa: E402
from tbm_msgs_py.nodes.bag_recorder import BagRecorder  # noqa: E402
from tbm_msgs_py.nodes.parameters import node_parameters  # noqa: E402
from tbm_msgs_py.nodes.registry import NODES  # noqa: E402

pytestmark = pytest.mark.ros

# Texts that are no path of a file that a node makes: names, choices, addresses, and files that are only read.
NOT_WRITTEN = {"machine", "mapping", "schedule", "bag", "baseline", "loads", "host", "compression"}
NOT_WRITTEN |= {"alarm", "watch.baseline", "gsa.inputs"}
WRITTEN = [(AnalysisNode, "/tbm/analysis_node", "gsa.folder"), (AnalysisNode, "/tbm/analysis_node", "history")]
WRITTEN += [(AnalysisNode, "/tbm/analysis_node", "snapshot.folder")]
WRITTEN += [(BagRecorder, "/tbm/bag_recorder", "output")]


def test_every_path_written_to_is_confined():
    texts = [one for node in NODES for one in node_parameters(node).values() if type(one.default) is str]
    open_to_all = {one.name for one in texts if one.changes != "start" and not one.written}
    assert open_to_all == NOT_WRITTEN
    assert {one.name for one in texts if one.written} == {name for _, _, name in WRITTEN}


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """A root with a link out of it, what the start states, and what belongs to others."""
    monkeypatch.chdir(tmp_path)
    for name in ("ours", "stated", "others"):
        (tmp_path / name).mkdir()
    (tmp_path / "ours/link").symlink_to(tmp_path / "others")
    (tmp_path / "ours/circle").symlink_to(tmp_path / "ours/circle")
    return tmp_path


@pytest.mark.parametrize(("node", "name", "parameter"), WRITTEN)
def test_paths_over_ros_stay_below_the_root(host_node, peer, folders, node, name, parameter):
    started = {"data_root": folders / "ours", parameter: folders / "stated", "autostart": False}
    host_node(node, **started)
    for path in ("ours/new", "ours/a/b", str(folders / "ours/../ours/new"), "stated/new"):
        assert peer.set_parameters(name, **{parameter.replace(".", "__"): path}) == []
    outside = ("others/new", "/etc/new", "ours/../others/new", "ours/link/new", "ours/link", "", "ours_too", "a\0b")
    for path in (*outside, str(folders), str(folders / "ours/circle/new")):
        if path == "" and parameter != "gsa.folder":
            continue  # the default, or none
        (reason,) = peer.set_parameters(name, **{parameter.replace(".", "__"): path})
        assert parameter in reason
        assert "allowed" in reason
        assert len(reason.splitlines()) == 1
    assert list((folders / "others").iterdir()) == []


@pytest.mark.parametrize(("node", "name", "parameter"), WRITTEN)
def test_the_default_root_is_the_users_data(host_node, peer, folders, monkeypatch, node, name, parameter):
    monkeypatch.setenv("XDG_DATA_HOME", str(folders / "data"))
    host_node(node, autostart=False)
    key = parameter.replace(".", "__")
    assert peer.set_parameters(name, **{key: str(folders / "data/tbm_monitor/new")}) == []
    (reason,) = peer.set_parameters(name, **{key: str(folders / "data/new")})
    assert str(folders / "data/tbm_monitor") in reason


@pytest.mark.parametrize("parameter", ["data_root", "summary"])
def test_what_the_start_alone_states_stays(host_node, peer, folders, parameter):
    host_node(BagRecorder, autostart=False)
    assert len(peer.set_parameters("/tbm/bag_recorder", **{parameter: str(folders / "others/x")})) == 1
