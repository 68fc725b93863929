"""What a native install gets: `colcon build`, launch files, parameters, layouts, the systemd unit."""

import ast
import configparser
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

rclpy = pytest.importorskip("rclpy")

from processes import DEADLINE, wait_for  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402

from tbm_gsa.app.cli.commands import load  # noqa: E402
from tbm_msgs_py import OperatingPoint, topics  # noqa: E402
from tbm_msgs_py.base.drive_state import DriveState  # noqa: E402
from tbm_msgs_py.nodes import messages  # noqa: E402
from tbm_msgs_py.nodes.parameters import node_parameters  # noqa: E402
from tbm_msgs_py.nodes.registry import MACHINE_NODES, NODES  # noqa: E402

SOURCE = Path(__file__).parents[2]
LAUNCH, CONFIG = SOURCE / "launch", SOURCE / "config"
PARAMETERS = {node: node_parameters(node) for node in NODES}
NO_TOPICS = {topics.NAMESPACE, topics.RUN_GSA, topics.CANCEL_GSA}
NAMED = {text for name, text in vars(topics).items() if name.isupper() and name[0] != "_" and isinstance(text, str)}
OF_THE_MACHINE = NAMED - NO_TOPICS
OF_A_POINT = {
    name(point)
    for point in topics.TEST_POINTS
    for name in (topics.model_block, topics.model_accel, topics.field_block, topics.field_accel)
} | {topics.analysis(point, quantity) for point in topics.TEST_POINTS for quantity in topics.ANALYSIS_QUANTITIES}
CONTRACT = {topics.absolute(name) for name in OF_THE_MACHINE | OF_A_POINT}
# Packed samples: no panel and no curve takes them apart. And what every message is stamped with.
NOT_SHOWN = {name for name in CONTRACT if name.endswith(("/block", topics.MODEL_MESH_FORCES, topics.CLOCK))}
EXAMPLES = {  # a message of the topics with this last name
    "operating_point": messages.operating_point_message(0, OperatingPoint(0.5, 2e6, 1e7)),
    "wrench": messages.wrench(0, [0.0] * 6),
    "drives": messages.drives_message(0, DriveState((0.0,) * 10, (0.0,) * 10)),
    "accel": messages.accel(0, [0.0] * 3),
    **dict.fromkeys(topics.ANALYSIS_QUANTITIES, messages.vector3(0, [0.0] * 3)),
}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Prefix that `colcon build` installs into, from a copy of the sources."""
    folder = tmp_path_factory.mktemp("workspace")
    leave = shutil.ignore_patterns(".*", "build", "dist", "*.egg-info", "__pycache__", "docs", "test", "benchmarks")
    shutil.copytree(SOURCE, folder / "src" / "tbm_monitor", ignore=leave)
    command = [sys.executable, "-m", "colcon", "--log-base", "log", "build", "--paths", "src/tbm_monitor"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "install" / "tbm_monitor"


def test_colcon_installs_what_ros2_run_and_launch_look_for(built):
    executables = built / "lib" / "tbm_monitor"
    assert {*NODES, "tbm-monitor"} == {file.name for file in executables.iterdir()}
    share = built / "share" / "tbm_monitor"
    assert (built / "share/ament_index/resource_index/packages/tbm_monitor").is_file()
    for name in ("package.xml", "launch/tbm_monitor.launch.py", "config/nodes.yaml", "config/layouts/foxglove.json"):
        assert (share / name).is_file(), name
    assert (share / "bags" / "field_dz101" / "metadata.yaml").is_file()


@pytest.mark.ros
def test_what_colcon_installed_starts_and_ends(built, tmp_path):
    (packages,) = built.glob("lib/python*/site-packages")
    environment = {**os.environ, "PYTHONPATH": str(packages)}
    started = {}
    for node in NODES:
        command = [built / "lib" / "tbm_monitor" / node, "--ros-args", "-p", "autostart:=false"]
        with (tmp_path / node).open("wb") as log:
            started[node] = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=log, stderr=log)
    context = rclpy.context.Context()
    context.init()
    watching = rclpy.create_node("watching", context=context)
    try:
        wait_for(lambda: set(NODES) <= set(watching.get_node_names()))
    finally:
        for process in started.values():
            process.send_signal(signal.SIGTERM)
        ended = {node: process.wait(DEADLINE) for node, process in started.items()}
        watching.destroy_node()
        context.shutdown()
    assert ended == dict.fromkeys(NODES, 0)
    assert not any((tmp_path / node).read_text() for node in NODES)


def test_launch_files_name_existing_nodes_and_parameters():
    described = yaml.safe_load((LAUNCH / "tbm_monitor.launch.yaml").read_text())["launch"]
    launched = [entry["node"] for entry in described if "node" in entry]
    assert [node["exec"] for node in launched] == [node["name"] for node in launched]
    assert all(node["pkg"] == "tbm_monitor" for node in launched)
    names = {node["exec"] for node in launched}
    assert names == set(MACHINE_NODES) <= set(NODES)
    arguments = {entry["arg"]["name"] for entry in described if "arg" in entry}
    used = set(re.findall(r"\$\(var (\w+)\)", (LAUNCH / "tbm_monitor.launch.yaml").read_text()))
    assert arguments == used

    tree = ast.parse((LAUNCH / "tbm_monitor.launch.py").read_text())
    assert "MACHINE_NODES" in {one.id for one in ast.walk(tree) if isinstance(one, ast.Name)}
    calls = [call for call in ast.walk(tree) if isinstance(call, ast.Call) and isinstance(call.func, ast.Name)]
    for kind in ("DeclareLaunchArgument", "LaunchConfiguration"):
        assert {call.args[0].value for call in calls if call.func.id == kind} == arguments


def test_the_launch_file_is_one_where_launch_is_there():
    pytest.importorskip("launch_ros")
    code = compile((LAUNCH / "tbm_monitor.launch.py").read_text(), "tbm_monitor.launch.py", "exec")
    scope = {}
    exec(code, scope)
    assert len(scope["generate_launch_description"]().entities) == 6


def test_the_yaml_launch_file_is_one_where_launch_is_there():
    pytest.importorskip("launch_yaml")
    pytest.importorskip("launch_ros")  # which knows what a node is
    from launch.frontend import Parser

    root, parser = Parser.load(str(LAUNCH / "tbm_monitor.launch.yaml"))
    assert len(parser.parse_description(root).entities) == 6


def flat(parameters, prefix=""):
    for name, value in parameters.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def test_the_parameter_file_holds_the_defaults():
    """But for the load node, which waits for the dynamics."""
    for key, value in yaml.safe_load((CONFIG / "nodes.yaml").read_text()).items():
        given = dict(flat(value["ros__parameters"]))
        declared = PARAMETERS[key.removeprefix("/**/")]
        assert set(given) <= set(declared)
        assert given.pop("wait_for_subscribers", 1) == 1
        assert given == {name: declared[name].default for name in given}
        unusual = {"autostart", "wait_for_subscribers", "summary", "schedule", "schedule_columns", "schedule_where"}
        assert set(declared) - set(given) <= unusual


def follow(topic, fields):
    """What a path leads to in a message of the topic."""
    found = EXAMPLES[topic.rpartition("/")[2]]
    for field in fields:
        name, _, index = field.partition("[")
        found = getattr(found, name)
        if index:
            found = found[int(index.removesuffix("]"))]
    return found


def test_the_foxglove_layout_shows_the_contract():
    layout = json.loads((CONFIG / "layouts" / "foxglove.json").read_text())
    panels = layout["configById"]
    assert set(re.findall(r"\w+!\w+", json.dumps(layout["layout"]))) == set(panels)
    drawn = [path["value"].split(".") for panel in panels.values() for path in panel.get("paths", ())]
    for topic, *fields in drawn:
        assert isinstance(follow(topic, fields), float), (topic, fields)
    whole = {panel[key] for panel in panels.values() for key in ("topicToRender", "topicPath") if key in panel}
    assert {topic for topic, *_ in drawn} | whole == CONTRACT - NOT_SHOWN


def test_the_plotjuggler_layout_shows_the_contract():
    """Its names of diagnostics are held against nodes that run, in test_machines."""
    curves = ElementTree.parse(CONFIG / "layouts" / "plotjuggler.xml").findall(".//curve")
    shown = set()
    for name in (curve.get("name") for curve in curves):
        (topic,) = [known for known in CONTRACT if name.startswith(f"{known}/")]
        shown.add(topic)
        fields = name.removeprefix(f"{topic}/").split("/")
        if topic.endswith((topics.DIAGNOSTICS, topics.GSA_STATUS, topics.ROCK, topics.MACHINE)):
            continue
        message = EXAMPLES[topic.rpartition("/")[2]]
        if isinstance(message, JointState):  # which it names by joint
            joint, field = fields
            assert joint in message.name, name
            assert len(getattr(message, field)) == len(message.name), name
        else:
            assert isinstance(follow(topic, fields), float), name
    # Tables and no curves: one message a study, events, and what the site says.
    assert shown == CONTRACT - NOT_SHOWN - set(map(topics.absolute, (topics.GSA_RESULT, topics.EVENTS, topics.CONTEXT)))


def test_the_systemd_unit_starts_a_command_that_there_is(tmp_path):
    unit = configparser.RawConfigParser(strict=False)
    unit.optionxform = str
    unit.read(CONFIG / "tbm_monitor.service")
    program, command, *options = unit["Service"]["ExecStart"].split()
    assert Path(program).name == "tbm-monitor"
    known = {name for parameter in load(command).params for name in parameter.opts}
    assert set(options[::2]) <= known
    if shutil.which("systemd-analyze"):
        copy = tmp_path / "tbm_monitor.service"
        copy.write_text((CONFIG / "tbm_monitor.service").read_text().replace(program, sys.executable))
        done = subprocess.run(["systemd-analyze", "verify", copy], capture_output=True, text=True, check=False)
        assert "Unknown" not in done.stderr, done.stderr
