"""Lifecycle of the nodes whose own tests do not go through it, and of one whose hooks fail."""

from pathlib import Path

import pytest

rclpy = pytest.importorskip("rclpy")

from peer import Peer  # noqa: E402
from rcl_interfaces.msg import Parameter as ParameterMessage  # noqa: E402
from rcl_interfaces.msg import ParameterValue  # noqa: E402
from rcl_interfaces.srv import (  # noqa: E402
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from std_msgs.msg import Empty  # noqa: E402

from tbm_gsa.app.nodes.analysis_node import AnalysisNode  # noqa: E402
from tbm_gsa.app.nodes.live_view import LiveView  # noqa: E402
from tbm_gsa.app.nodes.web_view import WebView  # noqa: E402
from tbm_msgs_py import Bag  # noqa: E402
from tbm_msgs_py.nodes.bag_player import BagPlayer  # noqa: E402
from tbm_msgs_py.nodes.bag_recorder import BagRecorder  # noqa: E402
from tbm_msgs_py.nodes.managed import ManagedNode  # noqa: E402
from tbm_msgs_py.nodes.parameters import NodeSettings, live_parameter  # noqa: E402

pytestmark = pytest.mark.ros

OK, WARN, ERROR = range(3)
ERRORS = {"refuses": ValueError, "breaks": KeyError}


class FaultySettings(NodeSettings):
    fails: str = live_parameter("", "hook that fails, and how")


class Faulty(ManagedNode[FaultySettings]):
    """Node whose hooks fail when a parameter says so."""

    def __init__(self, **options):
        super().__init__("faulty", FaultySettings, **options)

    def hook(self, name):
        failing, _, how = self.settings.fails.partition(" ")
        if failing == name:
            raise ERRORS[how](name)

    def configure(self):
        self.create_publisher(Empty, "configured", 1)
        self.hook("configure")

    def activate(self):
        self.create_publisher(Empty, "activated", 1)
        self.hook("activate")

    def deactivate(self):
        self.hook("deactivate")

    def cleanup(self):
        self.hook("cleanup")


# Each from the state before, with the state that it leads to and what may not be asked there.
ROUND = (
    ("configure", "inactive", "deactivate"),
    ("activate", "active", "activate"),
    ("deactivate", "inactive", "configure"),
    ("activate", "active", "cleanup"),
    ("deactivate", "inactive", "deactivate"),
    ("cleanup", "unconfigured", "activate"),
)
STEPS = {"configure": [], "activate": ["configure"], "deactivate": ["configure", "activate"], "cleanup": ["configure"]}


@pytest.fixture(scope="module")
def nodes(tmp_path_factory):
    """A peer, the nodes by name, and their folder; all wait unconfigured."""
    folder = tmp_path_factory.mktemp("nodes")
    parameters = {
        AnalysisNode: {"history": "none"},
        BagPlayer: {"bag": Path(__file__).parents[2] / "bags" / "field_dz101"},
        BagRecorder: {"output": folder / "first", "data_root": folder, "topics": "[/diagnostics]"},
        LiveView: {"port": 0},
        WebView: {"port": 0, "history": "none"},
        Faulty: {},
    }
    with Peer() as peer:
        hosted = [peer.host(factory, autostart=False, **given) for factory, given in parameters.items()]
        yield peer, {one.node.get_name(): one for one in hosted}, folder


def expect(peer, name, state, refused):
    """Find the node in this state, also after a transition that the state does not have."""
    assert peer.state(f"/tbm/{name}") == state
    assert not peer.transition(f"/tbm/{name}", refused), refused
    assert peer.state(f"/tbm/{name}") == state


def wait_until_told(peer, node, level, text):
    """Wait for what the node says of itself on `/diagnostics`."""
    name = f"tbm: {node.node.get_name()}"
    node.wait_for(lambda: peer.text(name) == text and peer.diagnostics[name].level == level)


def publishers(peer, topic):
    return {known.node_name for known in peer.node.get_publishers_info_by_topic(topic)}


def present_values(peer, name):
    """Parameters of a node, those of rclpy included, as `ros2 param dump` asks for them."""
    names = peer.call(ListParameters, f"/tbm/{name}/list_parameters").result.names
    values = peer.call(GetParameters, f"/tbm/{name}/get_parameters", GetParameters.Request(names=names)).values
    return [ParameterMessage(name=key, value=value) for key, value in zip(names, values, strict=True)]


def test_a_dumped_file_can_be_loaded_back(nodes):
    """Into the running node, most of whose parameters are fixed: to their present values they may be set."""
    peer, _, _ = nodes
    assert peer.transition("/tbm/bag_player", "configure")
    dumped = present_values(peer, "bag_player")
    assert {"use_sim_time", "qos_overrides./diagnostics.publisher.depth", "summary", "bag"} <= {
        one.name for one in dumped
    }
    results = peer.call(
        SetParameters, "/tbm/bag_player/set_parameters", SetParameters.Request(parameters=dumped)
    ).results
    assert [one.reason for one in results if not one.successful] == []
    request = SetParametersAtomically.Request(parameters=dumped)
    assert peer.call(SetParametersAtomically, "/tbm/bag_player/set_parameters_atomically", request).result.successful
    assert present_values(peer, "bag_player") == dumped
    for name, value in (("loop", True), ("summary", "elsewhere")):
        (reason,) = peer.set_parameters("/tbm/bag_player", **{name: value})
        assert reason
    assert peer.transition("/tbm/bag_player", "cleanup")


@pytest.mark.parametrize("name", ["bag_player", "bag_recorder", "live_view", "web_view"])
def test_every_parameter_is_described(nodes, name):
    """Those of the other nodes: test_machines."""
    peer, _, _ = nodes
    assert not peer.check_parameters("/tbm", name)


@pytest.mark.parametrize("name", ["analysis_node", "bag_player", "bag_recorder", "live_view", "web_view"])
def test_a_parameter_of_no_type_ends_no_node(nodes, name):
    peer, hosted, _ = nodes
    request = SetParameters.Request(parameters=[ParameterMessage(name="x", value=ParameterValue(type=99))])
    assert peer.call(SetParameters, f"/tbm/{name}/set_parameters", request).results == []
    expect(peer, name, "unconfigured", "deactivate")
    hosted[name].forgive()


@pytest.mark.parametrize("name", ["analysis_node", "bag_player", "bag_recorder", "live_view", "web_view"])
def test_there_and_back_and_there_again(nodes, name):
    peer, hosted, folder = nodes
    if name in ("live_view", "web_view"):
        pytest.importorskip({"live_view": "foxglove", "web_view": "aiohttp"}[name])
    expect(peer, name, "unconfigured", "deactivate")
    for transition, state, refused in ROUND:
        assert peer.transition(f"/tbm/{name}", transition), transition
        expect(peer, name, state, refused)
        wait_until_told(peer, hosted[name], OK if state == "active" else WARN, state)
    if name == "bag_recorder":  # what it wrote is whole, and it overwrites nothing
        assert Bag(folder / "first").info().duration >= 0.0
        assert not peer.transition(f"/tbm/{name}", "configure")
        expect(peer, name, "unconfigured", "activate")
        assert not peer.set_parameters(f"/tbm/{name}", output=str(folder / "second"))
    assert peer.transition(f"/tbm/{name}", "configure")
    assert peer.transition(f"/tbm/{name}", "shutdown")
    expect(peer, name, "finalized", "configure")
    wait_until_told(peer, hosted[name], WARN, "finalized")


@pytest.mark.parametrize(
    ("hook", "how", "answer", "left"),
    [
        ("configure", "refuses", False, "unconfigured"),
        ("configure", "breaks", False, "unconfigured"),
        ("activate", "refuses", False, "inactive"),
        ("activate", "breaks", False, "unconfigured"),
        ("deactivate", "refuses", True, "inactive"),
        ("deactivate", "breaks", False, "unconfigured"),
        ("cleanup", "refuses", True, "unconfigured"),
        ("cleanup", "breaks", False, "unconfigured"),
    ],
)
def test_a_hook_that_fails(nodes, hook, how, answer, left):
    peer, hosted, _ = nodes
    for step in STEPS[hook]:
        assert peer.transition("/tbm/faulty", step)
    assert not peer.set_parameters("/tbm/faulty", fails=f"{hook} {how}")
    assert peer.transition("/tbm/faulty", hook) == answer
    assert peer.state("/tbm/faulty") == left
    reason = f"{hook}: KeyError: '{hook}'" if how == "breaks" else f"{hook}: {hook}"
    assert hosted["faulty"].says(reason)
    wait_until_told(peer, hosted["faulty"], ERROR, f"{left} after an error: {reason}")
    peer.wait_for(lambda: not publishers(peer, "/tbm/activated"))
    peer.wait_for(lambda: bool(publishers(peer, "/tbm/configured")) == (left == "inactive"))
    assert not peer.set_parameters("/tbm/faulty", fails="")
    for step in ("activate", "deactivate", "cleanup") if left == "inactive" else ("configure", "cleanup"):
        assert peer.transition("/tbm/faulty", step), "it goes on as before"
    wait_until_told(peer, hosted["faulty"], WARN, "unconfigured")


def test_a_shutdown_goes_through_whatever_a_hook_says(nodes):
    peer, _, _ = nodes
    for step in STEPS["deactivate"]:
        assert peer.transition("/tbm/faulty", step)
    assert not peer.set_parameters("/tbm/faulty", fails="deactivate breaks")
    assert peer.transition("/tbm/faulty", "shutdown")
    expect(peer, "faulty", "finalized", "configure")
    peer.wait_for(lambda: not publishers(peer, "/tbm/activated") | publishers(peer, "/tbm/configured"))
