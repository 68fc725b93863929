"""Machine files with values changed: nothing else in the text is touched, and the file says what was asked for.

Sources: the shipped files, compared line by line with difflib; `Machine.with_inputs`; PyYAML, which reads what
ruamel.yaml wrote.
"""

import difflib
import re

import pytest
import yaml
from machine_files import TEXT, numbers

from tbm_dynamics import MachineError, load_machine, shipped_machines
from tbm_dynamics.machine.loading import described_by, machine_text
from tbm_dynamics.machine.writing import edited_text, updated_text

CHANGES = {"x4": 2e-3, "x8": 1.1, "x16": 0.7, "x24": 1.5}


def changed_lines(before, after):
    """Pairs of lines that differ, none added and none gone."""
    lines = list(difflib.unified_diff(before.splitlines(), after.splitlines(), lineterm="", n=0))[2:]
    removed, added = ([line[1:] for line in lines if line[0] == sign] for sign in "-+")
    assert len(removed) == len(added)
    return list(zip(removed, added, strict=True))


def numbers_of(line):
    return [float(word) for word in re.findall(r"(?<![\w.])[-+]?\d[\d.]*(?:e[-+]?\d+)?", line.split("#")[0])]


@pytest.mark.parametrize("name", shipped_machines())
def test_a_text_without_changes_stays_as_it_is(name):
    assert edited_text(machine_text(name), {}, "updated") == machine_text(name)


def test_only_changed_values_and_their_sources_differ():
    after = updated_text(load_machine("dz101"), CHANGES, "dz101_new", ["why\nit was", "since when"])
    head, new = after.split("\n", 2)[:2], after.split("\n", 2)[2]
    assert head == ["# why it was", "# since when"]
    pairs = changed_lines(TEXT, new)
    assert [old.split(":")[0].strip() for old, _ in pairs] == ["name", "steel", "- {name", "spline", "mesh"]
    for old, changed in pairs[1:]:
        assert changed.endswith(old[old.index("#") :] if "#" in old else "}")  # its comment
        assert "source: updated" in changed
    rock, spline = (numbers_of(pairs[i][1]) for i in (2, 3))
    assert rock[1:7] == pytest.approx([0.7e9] * 6)  # after the node
    assert rock[7:] == numbers_of(pairs[2][0])[7:]  # the turning inertia
    assert spline == pytest.approx([1.5e10, 7.5e9, 7.5e9, 1.5e10, 7.5e10, 7.5e10])
    assert "elasticity: 210e9, poisson: 0.3, damping: 0.002," in pairs[1][1]  # the others as they were written


def test_a_test_point_keeps_its_offset():
    text = TEXT.replace("girder: 47", "girder: {node: 47, offset: [0, 1.2, 0]}")
    after = edited_text(text, {("steel", "damping"): 2e-3}, "updated")
    assert [line for line in after.splitlines() if "girder: {node" in line] == [
        line for line in text.splitlines() if "girder: {node" in line
    ]
    assert described_by(after, "m").sensor_places["girder"].offset == (0.0, 1.2, 0.0)


def test_a_written_file_reads_back_as_the_variant(tmp_path):
    machine = load_machine("dz101")
    path = tmp_path / "new.yaml"
    path.write_text(updated_text(machine, CHANGES, "dz101_new", []), "utf-8")

    def values(description):
        """All that is said, but for name and sources."""
        text = re.sub(r'"source":"[^"]*"', "", description.model_dump_json())
        return text.replace("dz101_new", "dz101")

    written = load_machine(path).description
    assert values(written) == values(machine.with_inputs(**CHANGES).description)
    assert numbers(yaml.safe_load(path.read_text("utf-8")))["steel"]["damping"] == 2e-3


def test_a_section_that_a_file_leaves_out_is_added(tmp_path):
    path, machine = tmp_path / "new.yaml", load_machine("dz101")
    for value in (1.5, 0.25):  # then it is there, and changes
        path.write_text(updated_text(machine, {"loads.lateral": value}, "new", []), "utf-8")
        machine = load_machine(path)
        assert yaml.safe_load(path.read_text("utf-8"))["loads"]["factors"] == {"source": "updated", "lateral": value}
        factors = machine.description.loads.factors
        assert (factors.lateral, factors.axial_low, factors.source) == (value, 1.0, "updated")


@pytest.mark.parametrize("drives", ["", "\ndrives:  # seen\n  3: {off: true}  # off\n", "\ndrives: {3: {source: me}}"])
def test_values_of_a_drive_are_written_beside_what_is_there(tmp_path, drives):
    path = tmp_path / "mine.yaml"
    path.write_text(TEXT + drives, "utf-8")
    machine, changes = load_machine(path), {"drive_3.backlash": 450.0, "drive_10.mesh_error": 2.0}
    path.write_text(updated_text(machine, changes, "dz101", []), "utf-8")
    written = load_machine(path)
    expected = machine.with_inputs(**changes).description.drives
    assert {n: d.model_copy(update={"source": ""}) for n, d in written.description.drives.items()} == {
        n: d.model_copy(update={"source": ""}) for n, d in expected.items()
    }
    assert {drive.source for drive in written.description.drives.values()} == {"updated"}
    assert all(comment in path.read_text("utf-8") for comment in re.findall(r"# \w+", drives))


def test_a_layout_beside_the_file_is_found_from_elsewhere(tmp_path):
    (tmp_path / "mine.csv").write_text("cutter,type,radius_m,angle_deg,tilt_deg\n1,face,2.0,0,0\n", "utf-8")
    path = tmp_path / "mine.yaml"
    path.write_text(TEXT.replace("layout: dz101", "layout: mine.csv"), "utf-8")
    assert f"layout: {tmp_path / 'mine.csv'}\n" in updated_text(load_machine(path), {"x4": 2e-3}, "new", [])


def test_a_place_that_stands_for_several_is_refused(tmp_path):
    # One stiffness written once for two connections: to change one of them would change both.
    first = "{name: k_c_cf, between: [4, 5], type: bolt, stiffness: "
    second = "{name: k_c_fb, between: [6, 7], type: bolt, stiffness: "
    six = "[1e10, 5e9, 5e9, 1e10, 5e10, 5e10]"
    assert first + six in TEXT
    text = TEXT.replace(first + six, f"{first}&bolt {six}").replace(second + six, f"{second}*bolt")
    path = tmp_path / "mine.yaml"
    path.write_text(text, "utf-8")
    with pytest.raises(MachineError, match=r"^dz101: cannot be changed: write out what its aliases \(\*\) stand for$"):
        updated_text(load_machine(path), {"x18": 2.0}, "new", [])


@pytest.mark.parametrize(("inputs", "name"), [({"x4": -1.0}, "new"), ({"x99": 1.0}, "new"), ({"x4": 2e-3}, "no name")])
def test_what_the_machine_does_not_allow_is_refused(inputs, name):
    with pytest.raises(MachineError) as caught:
        updated_text(load_machine("dz101"), inputs, name, [])
    assert "\n" not in str(caught.value)
