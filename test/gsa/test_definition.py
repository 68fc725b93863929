"""The file that defines a study: what it may say, and one line for everything else."""

import pytest

from tbm_gsa.sensitivity.study.definition import read_definition
from tbm_gsa.sensitivity.study.distributions import LogUniform, Normal, Triangular, Uniform
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, Input, InputSet

TEXT = """
inputs:
  x2:
  x7: {lower: 200, upper: 400}
  x9: {distribution: normal, mean: 8.1e9, std: 2e8, lower: 7.5e9, upper: 8.5e9}
  x11: {distribution: log-uniform, lower: 2e-3, upper: 5e-3}
  x16: {distribution: triangular, lower: 0.5, mode: 1, upper: 2, initial: 1.25}
groups:
  meshing: [x7, x9]
outputs: [MF_M, rms_cutterhead_x]
"""


def _read(tmp_path, text):
    path = tmp_path / "study.yaml"
    path.write_text(text)
    return read_definition(path)


def test_a_file_with_everything(tmp_path):
    definition = _read(tmp_path, TEXT)
    inputs = definition.inputs
    assert inputs.codes == ("x2", "x7", "x9", "x11", "x16")
    assert inputs["x2"] == PAPER_INPUTS["x2"]
    assert inputs["x7"].distribution == Uniform(200.0, 400.0)
    assert inputs["x9"].distribution == Normal(7.5e9, 8.5e9, mean=8.1e9, std=2e8)
    assert inputs["x11"].distribution == LogUniform(2e-3, 5e-3)
    assert inputs["x16"].distribution == Triangular(0.5, 2.0, mode=1.0)
    # given; the paper's where it is inside; else the median, here √(lower · upper)
    assert [inputs[code].initial for code in ("x16", "x7", "x9")] == [1.25, 300.0, 8.1e9]
    assert inputs["x11"].initial == pytest.approx((2e-3 * 5e-3) ** 0.5)
    assert (inputs["x16"].kind, inputs["x16"].symbol) == ("multiplier", "k_r,ct")
    assert inputs.groups == {"meshing": ("x7", "x9")}
    assert definition.outputs == ("MF_M", "rms_cutterhead_x")
    assert tuple(Input.from_dict(item.to_dict()) for item in inputs.inputs) == inputs.inputs


def test_the_paper_s_ranges_by_their_codes_alone(tmp_path):
    definition = _read(tmp_path, "inputs: {x2, x16}")
    assert definition.inputs == InputSet((PAPER_INPUTS["x2"], PAPER_INPUTS["x16"]))
    assert definition.outputs == ()


NORMAL = "inputs: {{x2: {{distribution: normal, {}}}}}"
LOG_NORMAL = "inputs: {{loads.axial_low: {{distribution: log-normal, {}}}}}"
GROUPS = "inputs: {{x2, x3, x4}}\ngroups: {{{}}}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("inputs: {x26: {lower: 0, upper: 1}}", "unknown input 'x26', allowed: x1, x2"),
        ("inputs: {drive_3.tooth: {lower: 0, upper: 1}}", "loads.moments, drive_N.backlash, drive_N.mesh_error"),
        ("inputs: {x2: {lower: 2000, upper: 1000}}", "input x2: lower 2000, allowed: below upper, 1000"),
        ("inputs: {x2: {lower: 1000, upper: 1000}}", "input x2: lower 1000, allowed: below upper, 1000"),
        ("inputs: {x2: {lower: 1000}}", "input x2: upper: missing, allowed: a uniform distribution with lower, upper"),
        (
            "inputs: {x2: {lower: 1, upper: 2, mean: 3}}",
            "unknown key 'mean' of a uniform distribution, allowed: lower,",
        ),
        ("inputs: {x2: [1, 2]}", "input x2: [1, 2], allowed: a mapping such as"),
        ("inputs: {x2: {lower: low, upper: 2}}", "input x2: lower 'low', allowed: a number"),
        ("inputs: {x2: {lower: true, upper: 2}}", "input x2: lower True, allowed: a number"),
        ("inputs: {x2: {lower: .nan, upper: 2}}", "input x2: lower nan, allowed: a finite number"),
        ("inputs: {x2: {lower: 1, upper: .inf}}", "input x2: upper inf, allowed: a finite number"),
        ("inputs: {x2: {lower: 1, upper: 2, initial: 3}}", "input x2: initial 3, allowed: 1 to 2"),
        ("inputs: {x2: {lower: 1, upper: 2}, x2: {lower: 1, upper: 3}}", "key 'x2' is given twice"),
        ("inputs: {x2: {distribution: beta, lower: 1, upper: 2}}", "input x2: unknown distribution 'beta', allowed:"),
        (
            NORMAL.format("mean: 1, std: 1"),
            "lower, upper: missing, allowed: a normal distribution with lower, upper, mean, std",
        ),
        (NORMAL.format("mean: 1, std: 0, lower: 0, upper: 2"), "input x2: std 0, allowed: above 0"),
        (NORMAL.format("mean: 3, std: 1, lower: 0, upper: 2"), "input x2: mean 3, allowed: 0 to 2"),
        (NORMAL.format("mean: 1, sigma: 1, lower: 0, upper: 2"), "input x2: unknown key 'sigma'"),
        (
            "inputs: {x2: {distribution: triangular, lower: 0, upper: 2, mode: 3}}",
            "input x2: mode 3, allowed: 0 to 2",
        ),
        (
            "inputs: {x2: {distribution: log-uniform, lower: 0, upper: 2}}",
            "input x2: lower 0 of a log-uniform distribution, allowed: above 0",
        ),
        (LOG_NORMAL.format("lower: 0, upper: 2, median: 1, log_sigma: 1"), "lower 0 of a log-normal distribution"),
        (LOG_NORMAL.format("lower: 1, upper: 2, median: 1, log_sigma: 0"), "log_sigma 0, allowed: above 0"),
        (LOG_NORMAL.format("lower: 1, upper: 2, median: 3, log_sigma: 1"), "median 3, allowed: 1 to 2"),
        (GROUPS.format("a: [x2, x3], b: [x3, x4]"), "group b: input x3 is in group a already"),
        (GROUPS.format("a: [x2, x2]"), "group a: input x2 is in group a already"),
        (GROUPS.format("a: [x5]"), "group a: unknown input 'x5', allowed: x2, x3, x4"),
        (GROUPS.format("a: []"), "group a: no input, allowed: at least one"),
        (GROUPS.format("x2: [x3]"), "group x2: an input has this name"),
        (GROUPS.format("a: x2"), "group a: 'x2', allowed: a list of names"),
        ("inputs: {x2}\ngroups: [x2]", "groups: ['x2'], allowed: a mapping"),
        ("inputs: {x2}\noutputs: []", "outputs: none, allowed: at least one, or no such key"),
        ("inputs: {x2}\noutputs: MF_M", "outputs: 'MF_M', allowed: a list of names"),
        ("inputs: {x2}\noutput: [MF_M]", "unknown key 'output', allowed: inputs, groups, outputs"),
        ("inputs: {}", "inputs: none, allowed: at least one"),
        ("x2: {lower: 1, upper: 2}", "not a study definition, allowed: a mapping with keys of inputs"),
        ("inputs: {x2: {lower: 1", "not YAML"),
        ("", "not a study definition, allowed: a mapping with keys of inputs"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(StudyError) as caught:
        _read(tmp_path, text)
    assert message in str(caught.value)
    assert str(tmp_path / "study.yaml") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_drive_s_own_inputs_have_ranges(tmp_path):
    inputs = _read(tmp_path, "inputs: {drive_3.backlash: , drive_12.tooth_stiffness: {lower: 0.6, upper: 0.9}}").inputs
    assert inputs.codes == ("drive_3.backlash", "drive_12.tooth_stiffness")
    own, soft = inputs.inputs
    assert (own.unit, own.lower, own.initial, own.upper, own.name) == ("µm", 100.0, 300.0, 500.0, "Backlash, drive 3")
    assert (soft.lower, soft.initial, soft.upper, soft.kind) == (0.6, pytest.approx(0.75), 0.9, "multiplier")


def test_factors_of_the_loads_have_a_log_normal_prior(tmp_path):
    (item,) = _read(tmp_path, "inputs: {loads.axial_low: }").inputs.inputs
    assert (item.code, item.initial, item.lower, item.upper) == ("loads.axial_low", 1.0, 0.125, 8.0)
    # 68 % of a log-normal law lie within one standard deviation of the logarithm, ln 2.
    inside = item.distribution.to_unit([0.5, 2.0])
    assert inside[1] - inside[0] == pytest.approx(0.6827 / 0.9973, abs=1e-4)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(StudyError, match=r"none\.yaml: cannot be read"):
        read_definition(tmp_path / "none.yaml")
