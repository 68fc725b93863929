"""Pinion–ring meshes: contact ratio, stiffness over a cycle, error, phases.

Sources: the line of action intersected with the tip circles by root finding; the discrete Fourier transform of a
rectangular wave; the formulas of ISO 1328-1:1995, Annex A, worked out by hand for m = 22 mm, d = 352 mm. Tolerances are
rounding, except where a sampled wave (2¹⁶ points) stands in for the exact one.
"""

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st

from tbm_dynamics import load_machine
from tbm_dynamics.integration.lanes import lanes_for, widened
from tbm_dynamics.integration.laws import CouplingLaws, MeshInputs, coupling_forces
from tbm_dynamics.mesh.error import composite_tolerances
from tbm_dynamics.mesh.geometry import InternalPair
from tbm_dynamics.mesh.ishikawa import mesh_stiffness
from tbm_dynamics.mesh.stiffness import rounded_variation

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


@settings(max_examples=40)
@given(pinion=st.integers(14, 30), ring=st.integers(100, 250), module=st.floats(0.005, 0.03), angle=st.floats(20, 28))
def test_contact_ratio_of_other_pairs(pinion, ring, module, angle):
    pair = InternalPair(pinion, ring, module, np.radians(angle))
    assert pair.contact_ratio == pytest.approx(
        contact_ratio_on_paper(pinion, ring, module, np.radians(angle)), rel=1e-9
    )


def test_radii_follow_from_teeth_and_module():
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


def over_a_cycle(variation, points=4096):
    """Stiffness over its mean at equal steps of the cycle, from its Fourier coefficients."""
    angle = 2.0 * np.pi * np.outer(np.arange(points) / points, np.arange(1, len(variation) // 2 + 1))
    return 1.0 + np.cos(angle) @ variation[0::2] + np.sin(angle) @ variation[1::2]


@settings(max_examples=40)
@given(ratio=ratios, levels=st.floats(1.0, 2.2))
def test_stiffness_keeps_its_levels(ratio, levels):
    table = over_a_cycle(rounded_variation(two_levels(ratio, levels)))
    single = 1.0 / ((ratio - 1.0) * levels + 2.0 - ratio)
    # Lanczos factors leave 1.2 % of a jump as overshoot (Hamming, Digital Filters), here beside two jumps.
    slack = 0.025 * (levels - 1.0) * single + 1e-4
    assert table.min() >= single - slack
    assert table.max() <= levels * single + slack


@settings(max_examples=30)
@given(ratio=ratios, levels=st.floats(1.1, 2.2))
def test_stiffness_has_the_harmonics_of_the_rectangular_wave(ratio, levels):
    # k̄ + Σ 2(k₂−k₁)/(nπ) sin(nπ(ε−1)) cos(n(ωt − π(ε−1))), the project's reference.
    single = 1.0 / ((ratio - 1.0) * levels + 2.0 - ratio)
    n = np.arange(1, LANCZOS)
    amplitude = 2.0 * (levels - 1.0) * single / (n * np.pi) * np.sin(n * np.pi * (ratio - 1.0)) * np.sinc(n / LANCZOS)
    found = rounded_variation(two_levels(ratio, levels))
    assert found[0::2] == pytest.approx(amplitude * np.cos(n * np.pi * (ratio - 1.0)), abs=2e-4)
    assert found[1::2] == pytest.approx(amplitude * np.sin(n * np.pi * (ratio - 1.0)), abs=2e-4)


def test_tolerances_are_those_worked_out_by_hand():
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
def couplings():
    return load_machine("dz101").assemble().couplings


PHASES = np.array([0.0, 0.2, 0.4, 0.6, 0.8] * 2)  # 15.2 teeth from pinion to pinion: a fifth of a cycle each
GOLDEN = 0.6180339887498949


@settings(max_examples=60)
@given(cycle=st.floats(-50.0, 5000.0))
def test_every_pinion_sees_stiffness_and_error_at_its_own_phase(couplings, cycle):
    stiffness, error, slope = (part[0, :10] for part in couplings.waves.evaluate(np.array([cycle])))
    middles = (np.arange(2048) + 0.5) / 2048
    variation = rounded_variation(mesh_stiffness(PAIR, 0.40, 210e9, 0.3, middles))
    angle = 2.0 * np.pi * np.outer(cycle - PHASES, np.arange(1, LANCZOS))
    expected = 8.1e9 * (1.0 + np.cos(angle) @ variation[0::2] + np.sin(angle) @ variation[1::2])
    assert stiffness == pytest.approx(expected, rel=1e-9)
    tooth, total = composite_tolerances(0.022, 0.352, PAIR.contact_ratio, 5)
    mesh, shaft = 2 * np.pi * (cycle - PHASES), 2 * np.pi * (cycle / 16 + GOLDEN * np.arange(10))
    assert error == pytest.approx(tooth / 2 * np.sin(mesh) + (total - tooth) / 2 * np.sin(shaft), abs=1e-14)
    rate = 2 * np.pi * (tooth / 2 * np.cos(mesh) + (total - tooth) / 2 * np.cos(shaft) / 16)
    assert slope == pytest.approx(rate, abs=1e-12)


def test_every_gearbox_repeats_with_its_stages_and_planets(couplings):
    # The output stage turns with the pinion shaft, the motor's stage 1 + 86/22 times as fast: mesh cycles of a turn.
    waves, output, motor = couplings.waves, 86.0, 83.0 * (1.0 + 86.0 / 22.0)
    assert waves.turns == pytest.approx(np.array([16.0, output, motor, 1.0, output / 32, motor / 32]) / 16.0)
    # Runs over whole turns of everything: what a gearbox does has no other frequencies than these.
    turn = 16.0 * np.arange(2**16) / 2**16
    stiffness, _, _ = waves.evaluate(11 * turn)
    _, error, _ = waves.evaluate(176 * turn[::4])
    compliance = np.abs(np.fft.rfft(1.0 / stiffness[:, 10])) / len(turn)
    lines = np.flatnonzero(compliance > 1e-9 * compliance[0])
    # Sequentially phased planets (22/3 and 19/3 teeth apart): only each third harmonic of a mesh is left.
    assert lines.tolist() == [0, 3 * 11 * 86, 3 * 83 * 54]
    swing = np.abs(np.fft.rfft(error[:, 10]))
    assert np.flatnonzero(swing > 1e-6 * swing.max()).tolist() == [176 * 86 // 32, 16 * 83 * 54 // 32]
    # Mean compliance: the spring that the system is built with.
    assert 1.0 / couplings.stiffness[10] == pytest.approx(np.mean(1.0 / stiffness[:, 10]), rel=1e-9)


@settings(max_examples=20)
@given(start=st.floats(0.0, 1e6), turn=st.floats(1e-4, 0.05))
def test_mesh_inputs_of_a_block_are_the_sums_of_the_waves(couplings, start, turn):
    deflection = np.linspace(1e-4, 2e-4, 20)
    mesh_inputs = MeshInputs(couplings, deflection, 8, (0.5, 1.0))
    mesh_inputs.fill(start, turn, 14.0)
    values = mesh_inputs.values.reshape(8, 2, 3, -1)
    lanes = lanes_for(10)
    places = np.r_[0:10, lanes : lanes + 10]
    for stage, share in enumerate((0.5, 1.0)):
        stiffness, error, slope = couplings.waves.evaluate(start + (np.arange(8) + share) * turn)
        assert values[:, stage, 0][:, places] == pytest.approx(stiffness, rel=1e-7)
        assert values[:, stage, 1][:, places] == pytest.approx(deflection + error, abs=1e-10)
        assert values[:, stage, 2][:, places] == pytest.approx(14.0 * slope, abs=1e-7)


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
    # Statics 120 µm and 2e5 N, the rest as motion; r is what F is above the mean linear part. All lanes alike.
    wide = np.ones(2 * lanes_for(1))
    force, residual = np.empty((2, len(wide)))
    motion = np.outer([deflection - 120e-6 - 10e-6, rate - 2e-3], wide)
    mesh_inputs = np.array([[9e9], [120e-6 + 10e-6], [2e-3]]) * wide
    laws = CouplingLaws(2e5 * wide, np.array([[8e9], [1e5], [150e-6]]) * wide)
    coupling_forces(motion, mesh_inputs[None], 0, laws, force, residual)
    assert force == pytest.approx(expected * wide, rel=1e-9, abs=1e-6)
    assert residual == pytest.approx(expected - 2e5 - 8e9 * motion[0] - 1e5 * motion[1], rel=1e-9)


def test_idle_lanes_stay_idle():
    assert lanes_for(10) % 8 == 0
    rows = widened(np.arange(20.0)[None], 10)[0]
    assert rows.reshape(2, -1)[:, :10].ravel().tolist() == list(range(20))
    assert np.all(rows.reshape(2, -1)[:, 10:] == 0.0)
