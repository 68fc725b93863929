"""The input set of the paper, and designs: how they are stratified, spread out and extended."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_files import RIG, all_connections, built, plain
from scipy.spatial.distance import cdist, pdist
from scipy.stats import qmc

from tbm_dynamics import load_machine
from tbm_gsa.explanation.curve_cache import at_operating_point
from tbm_gsa.sensitivity.study import design as designs
from tbm_gsa.sensitivity.study.definition import read_definition
from tbm_gsa.sensitivity.study.design import KINDS, add_points, make_design
from tbm_gsa.sensitivity.study.distributions import LogUniform, Normal, Triangular, Uniform
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, Input, InputSet, known_input
from tbm_gsa.sensitivity.study.machine_inputs import default_inputs, unvaried_inputs

HYPERCUBES = [kind for kind in KINDS if kind != "sobol"]


def test_table_4_of_the_paper():
    assert PAPER_INPUTS.codes == tuple(f"x{k}" for k in range(1, 26))
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
    assert {type(item.distribution) for item in PAPER_INPUTS.inputs} == {Uniform}
    multipliers = [item.code for item in PAPER_INPUTS.inputs if item.kind == "multiplier"]
    assert multipliers == ["x8", *(f"x{k}" for k in range(16, 26))]
    assert [code for members in PAPER_INPUTS.groups.values() for code in members] == list(PAPER_INPUTS.codes)


def _tight(data):
    """A copy that may be driven no faster, and with hardly more power."""
    point = data["operating_point"]
    power = point["torque_kn_m"] * point["speed_r_min"] * np.pi / 30.0
    limits = {"speed_r_min": point["speed_r_min"], "torque_kn_m": 1e9, "thrust_kn": 1e9, "power_kw": 1.02 * power}
    return data | {"operating_limits": limits | {"source": "test"}}


MACHINES = {
    "open380": lambda: load_machine("open380"),
    "rig": lambda: load_machine(RIG),
    "at its limits": lambda: built(_tight(plain("open380"))),
    "no limits": lambda: built({**plain("open380"), "operating_limits": None}),
}


@pytest.mark.parametrize("name", MACHINES)
def test_inputs_of_any_machine_are_table_4s_as_factors(name):
    machine = MACHINES[name]()
    inputs, point = default_inputs(machine), machine.description.operating_point
    own = (point.speed_r_min, point.torque_kn_m, point.thrust_kn)
    assert [inputs[code].initial for code in ("x1", "x2", "x3")] == [*own]
    for item in inputs.inputs:
        paper = known_input(item.code)
        factors = np.array([item.lower, item.upper]) / item.initial
        wanted = np.array([paper.lower, paper.upper]) / paper.initial
        assert factors[0] == pytest.approx(wanted[0], rel=1e-3)
        assert factors[1] <= wanted[1] * 1.001
        if item.code not in ("x1", "x2", "x3"):
            assert factors[1] == pytest.approx(wanted[1], rel=1e-3)
    # The machine allows all that a sample may be.
    for end in ("lower", "upper"):
        machine.with_inputs(**{item.code: getattr(item, end) for item in inputs.inputs})
    grouped = [code for members in inputs.groups.values() for code in members]
    assert sorted(grouped) == sorted(inputs.codes)


def test_inputs_are_those_a_machine_has():
    assert default_inputs(load_machine("dz101")) is PAPER_INPUTS
    assert [code for code in PAPER_INPUTS.codes if code not in default_inputs(load_machine("open380")).codes] == ["x19"]
    codes = default_inputs(load_machine(RIG)).codes
    names = ("brake caliper", "housing bolts", "bed springs", "main bearing")
    assert [code for code in codes if code.startswith("stiffness.")] == [f"stiffness.{name}" for name in names]
    assert not {f"x{k}" for k in (*range(16, 23), 25)} & {*codes}
    still = plain("open380")
    still["driveshaft"]["mesh"]["backlash"] = 0.0
    assert "x7" not in default_inputs(built(still)).codes
    assert unvaried_inputs(built(still)) == ("x7",)


def test_a_role_makes_a_name_free():
    data = plain("open380")
    for connection in all_connections(data):
        if connection["name"] == "k_r_ct":
            connection |= {"name": "rock at the face", "role": "k_r_ct"}
    machine = built(data)
    assert default_inputs(machine).codes == default_inputs(load_machine("open380")).codes
    first = machine.with_inputs(x16=2.0).description.cutterhead_bearing_gear.connections[0]
    assert first.stiffness == (1.2e9, 1.2e9, 1.2e9, 6e8, 6e8, 6e8)


def test_a_range_that_is_not_stated_is_the_machines(tmp_path):
    (tmp_path / "study.yaml").write_text("inputs: {x2: , drive_1.backlash: , stiffness.main bearing: }")
    found = read_definition(tmp_path / "study.yaml", load_machine(RIG)).inputs
    ends = [(round(item.lower, 4), round(item.upper, 4)) for item in found.inputs]
    assert ends == [(0.1974, 0.4934), (33.3333, 166.6667), (0.5, 2.0)]


def test_a_level_is_not_rounded_beyond_the_limits():
    machine = load_machine("open380")  # 1000 kW
    point = at_operating_point(machine, 12.46, 766.3, 5012.0).description.operating_point
    assert (point.speed_r_min, point.torque_kn_m, point.thrust_kn) == (12.46, 766.3, 5012.0)
    point = at_operating_point(machine, 9.004, 766.3, 5012.0).description.operating_point
    assert (point.speed_r_min, point.torque_kn_m, point.thrust_kn) == (9.0, 770.0, 5000.0)


def test_inputs_given_twice_are_refused():
    with pytest.raises(StudyError, match="input x2: given twice, allowed: once"):
        InputSet((PAPER_INPUTS["x2"], PAPER_INPUTS["x2"]))


LAWS = (Uniform(-1.0, 2.0), Normal(0.0, 3.0, 1.0, 0.5), LogUniform(1e-3, 1.0), Triangular(0.0, 2.0, 0.5))


def _bounds(inputs):
    return np.array([(item.lower, item.upper) for item in inputs.inputs]).T


def _set(count):
    laws = (LAWS[k % len(LAWS)] for k in range(count))
    return InputSet(tuple(Input(f"x{k}", "", "", "", "absolute", law.lower, law) for k, law in enumerate(laws)))


@pytest.fixture(scope="session")
def few_swaps():
    """A tenth of the swaps of coordinates, which change what holds on every axis or not at all."""

    def few(function, *arguments):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(designs, "SWAPS", designs.SWAPS // 10)
            return function(*arguments)

    return few


def _filled(inputs, points, slices):
    """Slices of equal probability that hold a point, by input."""
    places = np.floor(inputs.to_unit(points) * slices + 1e-9).clip(0, slices - 1)
    return [len(np.unique(column)) for column in places.T]


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32), train=st.integers(1, 60), inputs=st.integers(1, 6), kind=st.sampled_from(HYPERCUBES))
def test_a_latin_hypercube_has_one_point_in_every_slice(few_swaps, seed, train, inputs, kind):
    items = _set(inputs)
    assert _filled(items, few_swaps(make_design, items, train, 3, seed, kind).train, train) == [train] * inputs


@pytest.mark.parametrize("kind", KINDS)
def test_designs_depend_on_the_seed_and_nothing_else(kind):
    four = InputSet(PAPER_INPUTS.inputs[:4])
    one, two = make_design(four, 50, 20, 0, kind), make_design(four, 50, 40, 0, kind)
    np.testing.assert_array_equal(one.train, two.train)
    assert (one.train != make_design(four, 50, 20, 1, kind).train).any()
    assert (make_design(four, 20, 20, 0, kind).train != one.test).all()
    lower, upper = _bounds(four)
    assert ((one.train >= lower) & (one.train <= upper)).all()


def test_the_paper_s_design_is_scipy_s_random_hypercube():
    lower, upper = _bounds(PAPER_INPUTS)
    streams = np.random.SeedSequence(7).spawn(2)
    design = make_design(PAPER_INPUTS, 200, 20, 7)
    for points, stream in zip((design.train, design.test), streams, strict=True):
        unit = qmc.LatinHypercube(d=25, seed=np.random.default_rng(stream)).random(len(points))
        np.testing.assert_allclose(points, lower + unit * (upper - lower), rtol=1e-15)


def test_what_the_variants_are_better_at():
    unit = {kind: PAPER_INPUTS.to_unit(make_design(PAPER_INPUTS, 60, 1, 3, kind).train) for kind in KINDS}
    assert pdist(unit["lhs-maximin"]).min() > 1.2 * pdist(unit["lhs"]).min()
    assert qmc.discrepancy(unit["lhs-discrepancy"]) < 0.9 * qmc.discrepancy(unit["lhs"])


def test_a_sobol_design_is_scipy_s_sequence_and_goes_on_with_it():
    inputs = _set(4)
    long = make_design(inputs, 64, 1, 5, "sobol").train
    stream = np.random.SeedSequence(5).spawn(1)[0]
    expected = qmc.Sobol(d=4, seed=np.random.default_rng(stream)).random_base2(6)
    np.testing.assert_allclose(inputs.to_unit(long), expected, atol=1e-9)
    short = make_design(inputs, 20, 1, 5, "sobol").train
    np.testing.assert_array_equal(short, long[:20])
    np.testing.assert_array_equal(add_points(inputs, short, 44, 5, "sobol"), long[20:])


@settings(max_examples=30)
@given(
    seed=st.integers(0, 2**32),
    first=st.integers(1, 30),
    added=st.integers(1, 40),
    kind=st.sampled_from(["lhs", "lhs-maximin"]),
)
def test_added_points_fill_as_many_slices_as_can_be(few_swaps, seed, first, added, kind):
    inputs = _set(4)
    existing = few_swaps(make_design, inputs, first, 1, seed, kind).train
    new = few_swaps(add_points, inputs, existing, added, seed, kind)
    assert new.shape == (added, 4)
    total = first + added
    before = _filled(inputs, existing, total)
    assert _filled(inputs, np.vstack([existing, new]), total) == [held + added for held in before]
    if added % first == 0:
        assert before == [first] * 4  # so that the whole is a Latin hypercube again


def test_added_points_keep_away_from_the_others():
    inputs = InputSet(PAPER_INPUTS.inputs[:6])
    existing = make_design(inputs, 40, 1, 0).train
    new = add_points(inputs, existing, 40, 0)
    unit, kept = inputs.to_unit(new), inputs.to_unit(existing)
    rng = np.random.default_rng(1)
    shuffled = np.column_stack([rng.permutation(column) for column in unit.T])  # the same slices, paired by chance

    def nearest(points):
        return min(pdist(points).min(), cdist(points, kept).min())

    assert nearest(unit) > 1.5 * nearest(shuffled)
    assert (add_points(inputs, np.vstack([existing, new]), 40, 0) != new).all()


@pytest.mark.parametrize(("train", "test"), [(0, 5), (5, -1)])
def test_impossible_sizes_are_refused(train, test):
    with pytest.raises(StudyError, match=r"training and .* test points, allowed: at least 1 and at least 0"):
        make_design(PAPER_INPUTS, train, test, 0)


def test_unknown_designs_are_refused():
    with pytest.raises(StudyError, match="unknown design 'grid', allowed: lhs, lhs-discrepancy, lhs-maximin, sobol"):
        make_design(PAPER_INPUTS, 10, 2, 0, "grid")
