"""One SHA-256 names a machine wherever one is named: it is that of what the file says."""

from importlib import resources

from tbm_dynamics import load_machine
from tbm_gsa.provenance import machine_sha256
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation

SHIPPED = (resources.files("tbm_dynamics") / "machines" / "open380.yaml").read_text("utf-8")


def _written(folder, text):
    file = folder / "mine.yaml"
    file.write_text(text, "utf-8")
    return file


def test_a_study_names_the_machine_by_the_same_digits():
    for name in ("dz101", "open380"):
        found = machine_sha256(load_machine(name))
        assert MachineEvaluation.of(name, 1.0, 0).settings["machine_sha256"] == found
        assert len(found) == 64


def test_a_comment_and_another_place_change_no_digit(tmp_path):
    file = _written(tmp_path, f"# another head of the file\n{SHIPPED}")
    assert machine_sha256(load_machine(file)) == machine_sha256(load_machine("open380"))


def test_a_value_changes_the_digits(tmp_path):
    assert SHIPPED.count("thrust_kn: 5000,") == 1
    file = _written(tmp_path, SHIPPED.replace("thrust_kn: 5000,", "thrust_kn: 5001,"))
    assert machine_sha256(load_machine(file)) != machine_sha256(load_machine("open380"))


def test_inputs_of_a_sample_change_no_digit():
    machine = load_machine("open380")
    assert machine_sha256(machine.with_inputs(x16=2.0)) == machine_sha256(machine)
