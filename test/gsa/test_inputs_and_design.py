"""The input set of the paper, sets of the user, and Latin hypercubes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tbm_gsa.study.design import latin_hypercube
from tbm_gsa.study.errors import StudyError
from tbm_gsa.study.inputs import PAPER_INPUTS, Input, InputSet


def test_table_4_of_the_paper():
    assert PAPER_INPUTS.codes == tuple(f"x{k}" for k in range(1, 26))
    assert PAPER_INPUTS.bounds.shape == (25, 2)
    expected = {
        "x1": ("r/min", 5.6, 5.3, 5.9),
        "x2": ("kN·m", 2280.0, 1000.0, 2500.0),
        "x3": ("kN", 14000.0, 12000.0, 15000.0),
        "x5": ("GPa", 210.0, 200.0, 220.0),
        "x7": ("µm", 300.0, 100.0, 500.0),
        "x8": ("", 1.0, 0.8, 1.2),
        "x9": ("N/m", 8.1e9, 7.5e9, 8.5e9),
        "x10": ("", 0.05, 0.03, 0.17),
        "x11": ("", 1e-3, 2e-4, 5e-3),
        "x25": ("", 1.0, 0.5, 2.0),
    }
    for code, numbers in expected.items():
        item = PAPER_INPUTS[code]
        assert (item.unit, item.initial, item.lower, item.upper) == numbers
    multipliers = [item.code for item in PAPER_INPUTS.inputs if item.kind == "multiplier"]
    assert multipliers == ["x8", *(f"x{k}" for k in range(16, 26))]


def test_a_set_from_yaml(tmp_path):
    path = tmp_path / "inputs.yaml"
    path.write_text(
        "inputs:\n"
        "  x16: {lower: 1.5, upper: 2.5}\n"
        "  x2: {lower: 1500, upper: 2500, initial: 1600}\n"
        "  x4: {lower: 0.0, upper: 0.01}\n"
    )
    inputs = InputSet.from_yaml(path)
    assert inputs.codes == ("x16", "x2", "x4")
    assert inputs["x16"].initial == 2.0
    assert inputs["x16"].kind == "multiplier"
    assert inputs["x2"].initial == 1600.0
    assert inputs["x4"].initial == 1e-3
    assert InputSet.from_list(inputs.to_list()) == inputs


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("inputs: {x26: {lower: 0, upper: 1}}", "unknown input 'x26'; available: x1, x2"),
        ("inputs: {x2: {lower: 2000, upper: 1000}}", "input x2: lower 2000 must be below upper 1000"),
        ("inputs: {x2: {lower: 1000, upper: 1000}}", "input x2: lower 1000 must be below upper 1000"),
        ("inputs: {x2: {lower: 1000}}", "input x2: expected the keys lower, upper"),
        ("inputs: {x2: {lower: 1, upper: 2, mean: 3}}", "input x2: expected the keys lower, upper"),
        ("inputs: {x2: [1, 2]}", "input x2: expected the keys lower, upper"),
        ("inputs: {x2: {lower: low, upper: 2}}", "input x2: lower must be a number, got 'low'"),
        ("inputs: {x2: {lower: .nan, upper: 2}}", "input x2: lower, initial and upper must be finite"),
        ("inputs: {x2: {lower: 1, upper: 2, initial: 3}}", "input x2: initial 3 must lie in"),
        ("inputs: {}", "at least one input"),
        ("x2: {lower: 1, upper: 2}", "expected one key, 'inputs'"),
        ("inputs: {x2: {lower: 1", "not YAML"),
        ("", "expected one key, 'inputs'"),
    ],
)
def test_bad_sets_are_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "inputs.yaml"
    path.write_text(text)
    with pytest.raises(StudyError) as caught:
        InputSet.from_yaml(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(StudyError, match=r"none\.yaml: cannot be read"):
        InputSet.from_yaml(tmp_path / "none.yaml")


def test_inputs_given_twice_are_refused():
    with pytest.raises(StudyError, match="x2 is given twice"):
        InputSet((PAPER_INPUTS["x2"], PAPER_INPUTS["x2"]))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32), train=st.integers(1, 60), inputs=st.integers(1, 6))
def test_a_latin_hypercube_has_one_point_in_every_slice(seed, train, inputs):
    items = tuple(Input(f"x{k}", "", "", "", 0.0, -1.0 - k, 2.0 + k, "absolute") for k in range(inputs))
    design = latin_hypercube(InputSet(items), train, 3, seed)
    lower, upper = InputSet(items).bounds.T
    slices = np.floor((design.train - lower) / (upper - lower) * train).clip(0, train - 1)
    for column in slices.T:
        assert sorted(column) == list(range(train))


def test_designs_depend_on_the_seed_and_nothing_else():
    one, two = latin_hypercube(PAPER_INPUTS, 200, 20, 0), latin_hypercube(PAPER_INPUTS, 200, 40, 0)
    np.testing.assert_array_equal(one.train, two.train)
    assert (one.train != latin_hypercube(PAPER_INPUTS, 200, 20, 1).train).any()
    assert (latin_hypercube(PAPER_INPUTS, 20, 20, 0).train != one.test).all()


@pytest.mark.parametrize(("train", "test"), [(0, 5), (5, -1)])
def test_impossible_sizes_are_refused(train, test):
    with pytest.raises(StudyError, match="a design needs"):
        latin_hypercube(PAPER_INPUTS, train, test, 0)
