"""Pinion–ring meshes: contact ratio, stiffness over a cycle, error, phases.

Sources: the line of action intersected with the tip circles by root finding; the discrete Fourier transform of a
rectangular wave; the formulas of ISO 1328-1:1995, Annex A, worked out by hand for m = 22 mm, d = 352 mm. Tolerances are
rounding, except where a sampled wave (2¹⁶ points) or a linear interpolation (4096 points) stands in for the exact one.
"""

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st

from tbm_dynamics import load_machine
from tbm_dynamics.integration.kernel import mesh_condition, mesh_forces
from tbm_dynamics.integration.simulator import mesh_laws
from tbm_dynamics.mesh.error import composite_tolerances
from tbm_dynamics.mesh.geometry import InternalPair
from tbm_dynamics.mesh.stiffness import TABLE_SIZE, stiffness_table

PAIR = InternalPair(16, 152, 0.022, np.radians(25.0))
LANCZOS = 13  # one more than the harmonics kept


def contact_ratio_on_paper(pinion, ring, module, angle):
    """Length of the path of contact over the base pitch: where the line of action meets the tip circles."""
    r1, r2 = module * pinion / 2.0, module * ring / 2.0
    direction = np.array([np.sin(angle), np.cos(angle)])  # (radial, tangential), from the pitch point
    centres = {"pinion": np.array([-r1, 0.0]), "ring": np.array([-r2, 0.0])}

    def beyond(s, gear, tip):
        return np.linalg.norm(s * direction - centres[gear]) - tip

    # Outwards the path ends at the pinion's tip, inwards (towards the axis) at the ring's.
    out = scipy.optimize.brentq(beyond, 0.0, 10 * module, args=("pinion", r1 + module))
    back = scipy.optimize.brentq(beyond, -6 * module, 0.0, args=("ring", r2 - module))
    return (out - back) / (np.pi * module * np.cos(angle))


def test_contact_ratio_of_the_shipped_pair():
    assert PAIR.contact_ratio == pytest.approx(1.543, abs=5e-4)  # the project's reference
    assert PAIR.contact_ratio == pytest.approx(contact_ratio_on_paper(16, 152, 0.022, np.radians(25.0)), rel=1e-9)


@settings(max_examples=40, deadline=None)
@given(pinion=st.integers(14, 30), ring=st.integers(100, 250), module=st.floats(0.005, 0.03), angle=st.floats(20, 28))
def test_contact_ratio_of_other_pairs(pinion, ring, module, angle):
    pair = InternalPair(pinion, ring, module, np.radians(angle))
    assert pair.contact_ratio == pytest.approx(
        contact_ratio_on_paper(pinion, ring, module, np.radians(angle)), rel=1e-9
    )


def test_radii():
    assert PAIR.pinion_pitch_radius == pytest.approx(0.176)
    assert PAIR.ring_pitch_radius == pytest.approx(1.672)
    assert PAIR.centre_distance == pytest.approx(1.496)
    assert PAIR.ring_base_radius / PAIR.pinion_base_radius == pytest.approx(152 / 16)
    assert PAIR.ring_base_radius == pytest.approx(1.672 * 0.90630779)


@pytest.mark.parametrize("angle", [0.0, 1.0, 4.0])
def test_the_ring_is_driven_round_and_pushed_outwards(angle):
    line = PAIR.line_of_action(angle)
    at = PAIR.ring_pitch_radius * np.array([0.0, np.cos(angle), np.sin(angle)])
    assert np.linalg.norm(line) == pytest.approx(1.0)
    assert np.cross(at, line)[0] == pytest.approx(PAIR.ring_base_radius)  # the lever of the normal force
    assert line @ at / PAIR.ring_pitch_radius == pytest.approx(np.sin(np.radians(25.0)))


ratios = st.floats(1.05, 1.95)


def two_levels(ratio, levels, parts=2**16):
    """Rectangular pattern of mean 1: two pairs first, then one."""
    single = 1.0 / ((ratio - 1.0) * levels + 2.0 - ratio)
    phase = (np.arange(parts) + 0.5) / parts
    return np.where(phase < ratio - 1.0, levels * single, single)


@settings(max_examples=40, deadline=None)
@given(ratio=ratios, levels=st.floats(1.0, 2.2))
def test_stiffness_keeps_its_mean_and_its_levels(ratio, levels):
    mean = 8.1e9
    table = stiffness_table(two_levels(ratio, levels), mean)
    assert table.shape == (TABLE_SIZE,)
    assert table.mean() == pytest.approx(mean, rel=1e-13)
    single = mean / ((ratio - 1.0) * levels + 2.0 - ratio)
    # Lanczos factors leave 1.2 % of a jump as overshoot (Hamming, Digital Filters), here beside two jumps.
    slack = 0.025 * (levels - 1.0) * single + 1e-4 * mean
    assert table.min() >= single - slack
    assert table.max() <= levels * single + slack


@settings(max_examples=30, deadline=None)
@given(ratio=ratios, levels=st.floats(1.1, 2.2))
def test_stiffness_has_the_harmonics_of_the_rectangular_wave(ratio, levels):
    # k̄ + Σ 2(k₂−k₁)/(nπ) sin(nπ(ε−1)) cos(n(ωt − π(ε−1))), the project's reference.
    single = 1.0 / ((ratio - 1.0) * levels + 2.0 - ratio)
    n = np.arange(1, LANCZOS)
    amplitude = 2.0 * (levels - 1.0) * single / (n * np.pi) * np.sin(n * np.pi * (ratio - 1.0)) * np.sinc(n / LANCZOS)
    found = 2.0 * np.fft.rfft(stiffness_table(two_levels(ratio, levels), 1.0)) / TABLE_SIZE
    assert found[n] == pytest.approx(amplitude * np.exp(-1j * n * np.pi * (ratio - 1.0)), abs=2e-4)
    assert np.abs(found[LANCZOS:]).max() < 1e-14


def test_no_variation_when_none_is_kept():
    assert np.array_equal(stiffness_table(two_levels(1.5, 1.6), 8.1e9, 0.0), np.full(TABLE_SIZE, 8.1e9))


def test_tolerances_by_hand():
    # Line by line of the standard with √22 = 4.690416 and √352 = 18.76166, µm, grade 5.
    f_pt = 0.3 * (22 + 0.4 * 18.76166) + 4  # 12.8514
    f_alpha = 3.2 * 4.690416 + 0.22 * 18.76166 + 0.7  # 19.8369
    f_p = 0.3 * 22 + 1.25 * 18.76166 + 7  # 37.0521
    tooth, total = composite_tolerances(0.022, 0.352, 1.6, 5)
    assert (f_pt, f_alpha, f_p) == pytest.approx((12.8514, 19.8369, 37.0521), abs=1e-4)
    assert tooth == pytest.approx(0.7 * (4.3 + 12.8514 + 19.8369) * 1e-6, rel=1e-5)  # K = 0.2 · 5.6/1.6
    assert total - tooth == pytest.approx(37.0521e-6, rel=1e-5)


@pytest.mark.parametrize(("grade", "factor"), [(3, 0.5), (6, np.sqrt(2.0)), (7, 2.0), (9, 4.0)])
def test_two_grades_double_the_tolerance(grade, factor):
    fifth = composite_tolerances(0.022, 0.352, 1.5, 5)
    assert composite_tolerances(0.022, 0.352, 1.5, grade) == pytest.approx(tuple(factor * f for f in fifth))


@pytest.fixture(scope="module")
def meshes():
    return load_machine("dz101").assemble().meshes


def condition(meshes, cycle, rate=14.2):
    """Stiffness, error and error rate at a mesh phase, (3, 10), from the compiled function."""
    out = np.empty((4, 10))
    mesh_condition(cycle, rate, mesh_laws(meshes, np.zeros((2, 10))), out)
    return out[:3]


def test_phases_of_ten_pinions_on_152_teeth(meshes):
    # 15.2 teeth from pinion to pinion: a fifth of a cycle each.
    assert meshes.phases == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8] * 2, abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(cycle=st.floats(-50.0, 5000.0))
def test_every_pinion_sees_stiffness_and_error_at_its_own_phase(meshes, cycle):
    found = condition(meshes, cycle)
    grid = np.arange(TABLE_SIZE + 1) / TABLE_SIZE
    table = np.append(meshes.stiffness_table, meshes.stiffness_table[0])
    assert found[0] == pytest.approx(np.interp((cycle - meshes.phases) % 1.0, grid, table), rel=1e-9)
    tooth, total = composite_tolerances(0.022, 0.352, PAIR.contact_ratio, 6)
    mesh, shaft = 2 * np.pi * (cycle - meshes.phases), 2 * np.pi * (cycle / 16 + meshes.shaft_phases)
    assert found[1] == pytest.approx(tooth / 2 * np.sin(mesh) + (total - tooth) / 2 * np.sin(shaft), abs=1e-15)
    rate = 2 * np.pi * 14.2 * (tooth / 2 * np.cos(mesh) + (total - tooth) / 2 * np.cos(shaft) / 16)
    assert found[2] == pytest.approx(rate, abs=1e-12)


def test_run_out_differs_from_pinion_to_pinion(meshes):
    phases = np.sort(meshes.shaft_phases)
    assert np.diff(np.append(phases, phases[0] + 1.0)).min() > 0.03


@pytest.mark.parametrize(
    ("deflection", "rate", "expected"),
    [
        (200e-6, 0.0, 9e9 * 50e-6),
        (200e-6, 1e-3, 9e9 * 50e-6 + 1e5 * 1e-3),
        (149.9e-6, 1.0, 0.0),
        (0.0, 1.0, 0.0),
        (-149e-6, -1.0, 0.0),
        (-200e-6, -1e-3, -9e9 * 50e-6 - 1e5 * 1e-3),
    ],
)
def test_law_of_a_mesh(deflection, rate, expected):
    # Statics 120 µm and 2e5 N, the rest as motion; g is what F is above the mean linear part.
    force, excess = np.empty(1), np.empty(1)
    motion = np.array([deflection - 120e-6 - 10e-6, rate - 2e-3])
    held = np.array([[9e9], [120e-6 + 10e-6], [2e-3], [2e5]])
    mesh_forces(motion, held, np.array([8e9, 1e5, 150e-6]), force, excess)
    assert force[0] == pytest.approx(expected, rel=1e-9, abs=1e-6)
    assert excess[0] == pytest.approx(expected - 2e5 - 8e9 * motion[0] - 1e5 * motion[1], rel=1e-9)
