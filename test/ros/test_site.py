"""What a parameter file says of a node, beside what rclpy makes of the same file."""

from pathlib import Path

import pytest

from tbm_gsa.app.cli.run import page_command
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.nodes.parameter_file import ParameterFile

FILES = {
    "any namespace": "/**/load_node: {ros__parameters: {machine: a}}",
    "all nodes": "/**: {ros__parameters: {machine: a}}",
    "by its full name": "/tbm/load_node: {ros__parameters: {machine: a}}",
    "nested": "tbm: {load_node: {ros__parameters: {machine: a}}}",
    "one level": "/*/load_node: {ros__parameters: {machine: a}}",
    "the last one holds": "/**: {ros__parameters: {machine: b}}\n/**/load_node: {ros__parameters: {machine: a}}",
    "not the other node": "/**/load_node: {ros__parameters: {machine: a}}\n/**/watch: {ros__parameters: {machine: b}}",
}


def site(tmp_path, text):
    file = tmp_path / "site.yaml"
    file.write_text(text)
    return ParameterFile(file)


@pytest.mark.parametrize("name", FILES)
def test_what_a_file_says(tmp_path, name):
    assert site(tmp_path, FILES[name]).stated("load_node", "machine") == "a"


@pytest.mark.parametrize("name", FILES)
def test_ros_reads_the_same(tmp_path, name):
    rclpy = pytest.importorskip("rclpy")
    (tmp_path / "site.yaml").write_text(FILES[name] + "\n")
    context = rclpy.Context()
    rclpy.init(args=["--ros-args", "--params-file", str(tmp_path / "site.yaml")], context=context)
    node = rclpy.create_node("load_node", namespace="tbm", context=context, enable_rosout=False)
    found = node.declare_parameter("machine", "").value
    node.destroy_node()
    rclpy.shutdown(context=context)
    assert found == "a"


@pytest.mark.parametrize(
    "text",
    ["/**/dynamics_node: {ros__parameters: {machine: b}}", "/south/load_node: {ros__parameters: {machine: b}}", "{}"],
)
def test_what_it_does_not_say(tmp_path, text):
    assert site(tmp_path, text).stated("load_node", "machine") is None
    assert ParameterFile(None).stated("load_node", "machine") is None


def test_names_with_dots_are_groups(tmp_path):
    nested = site(tmp_path, "/**: {ros__parameters: {gsa: {folder: here}}}")
    assert nested.stated("analysis_node", "gsa.folder") == "here"
    assert site(tmp_path, "/**: {ros__parameters: {gsa.folder: here}}").stated("analysis_node", "gsa.folder") == "here"


def test_what_nodes_share_is_one_value(tmp_path):
    one = site(tmp_path, FILES["any namespace"])
    assert one.common(["load_node"], "machine", "b") == "a"
    with pytest.raises(InputError, match=r"machine: a of load_node, b of dynamics_node; allowed: one for all of them"):
        one.common(["load_node", "dynamics_node"], "machine", "b")


@pytest.mark.parametrize("text", ["- a", "a: [", "\x00"])
def test_what_is_no_parameter_file(tmp_path, text):
    with pytest.raises(InputError, match=r"site\.yaml: not (YAML|nodes with ros__parameters)"):
        site(tmp_path, text)


def test_the_page_is_told_what_the_analysis_is(tmp_path):
    stated = site(
        tmp_path,
        "/**/analysis_node: {ros__parameters: {history: h, alarm: threshold, threshold: 0.5, window: 3.0}}\n"
        "/**/web_view: {ros__parameters: {threshold: 0.4}}",
    )
    command = page_command(8080, "dz101", Path("out"), stated)
    assert command.parameters == {
        "machine": "dz101",
        "port": 8080,
        "folder": "out",
        "history": "h",
        "alarm": "threshold",
    }
