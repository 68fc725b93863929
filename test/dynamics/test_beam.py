"""Timoshenko beam element against closed forms.

Sources: the exact frequency equation of a simply supported Timoshenko beam (Timoshenko, Phil. Mag. 41, 1921: both
spectra are the roots of a quadratic in ω²), rods and shafts of d'Alembert's wave equation, Cowper's own solid and
thin-tube values (J. Appl. Mech. 33, 1966), Castigliano's cantilever. Tolerances: the error of the frequency
falls with h⁴ for slender elements and with h² for elements shorter than the beam is deep (their slope loses its
quadratic part), so that extrapolation from 16 and 32 elements leaves at most 1e-4; what is exact in theory is held to
rounding.
"""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tbm_dynamics.structure.beam import along_direction, beam_mass, beam_stiffness, circular_section

E, NU, RHO = 210e9, 0.3, 7850.0
G = E / (2.0 * (1.0 + NU))
DIAMETER = 0.5
BENDING = {"xy": (1, 5), "xz": (2, 4)}


def chain(length, elements, inner=0.3):
    """K and M of a straight beam along x in equal elements."""
    section = circular_section(DIAMETER, inner, NU)
    n = 6 * (elements + 1)
    K, M = np.zeros((n, n)), np.zeros((n, n))
    for i in range(elements):
        place = slice(6 * i, 6 * i + 12)
        K[place, place] += beam_stiffness(section, length / elements, E, NU)
        M[place, place] += beam_mass(section, length / elements, RHO, E, NU)
    return K, M, section


def frequencies(K, M, free):
    """Natural frequencies of the unknowns left free, rad/s."""
    place = np.ix_(free, free)
    return np.sqrt(np.maximum(scipy.linalg.eigh(K[place], M[place], eigvals_only=True), 0.0))


def hinged(length, elements, plane):
    """Lowest three frequencies of the simply supported beam bending in one plane."""
    K, M, section = chain(length, elements)
    across, turn = BENDING[plane]
    unknowns = [6 * i + d for i in range(elements + 1) for d in (across, turn)]
    free = [d for d in unknowns if d not in (across, 6 * elements + across)]
    return frequencies(K, M, free)[:3], section


def exact_hinged(length, section):
    """EIβ⁴ − ω²(ρA + ρIβ²(1 + E/κG)) + ω⁴ρ²I/κG = 0, β = nπ/L: both spectra, and the pure shear of n = 0."""
    area, second, kG = section.area, section.second_moment, section.shear_coefficient * G
    found = [np.sqrt(kG * area / (RHO * second))]
    for n in (1, 2, 3):
        b = n * np.pi / length
        middle = RHO * area + RHO * second * b**2 * (1.0 + E / kG)
        found += [*np.sqrt(np.roots([RHO**2 * second / kG, -middle, E * second * b**4]).real)]
    return np.sort(found)[:3]


@pytest.mark.parametrize("plane", ["xy", "xz"])
@pytest.mark.parametrize("slenderness", [2.0, 5.0, 20.0, 100.0])
def test_simply_supported_beam_of_any_slenderness(slenderness, plane):
    (coarse, section), (fine, _) = (hinged(slenderness * DIAMETER, count, plane) for count in (16, 32))
    exact = exact_hinged(slenderness * DIAMETER, section)
    assert fine == pytest.approx(exact, rel=3e-3)
    assert (4.0 * fine - coarse) / 3.0 == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize(("slenderness", "order"), [(3.0, 2.0), (1000.0, 4.0)])
def test_the_error_falls_with_the_element_length(slenderness, order):
    errors = []
    for elements in (8, 16):
        found, section = hinged(slenderness * DIAMETER, elements, "xy")
        errors.append(found[0] / exact_hinged(slenderness * DIAMETER, section)[0] - 1.0)
    assert errors[0] > errors[1] > 0.0  # a consistent mass bounds from above
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize(("direction", "speed"), [(0, np.sqrt(E / RHO)), (3, np.sqrt(G / RHO))])
def test_rod_and_shaft_fixed_at_one_end(direction, speed):
    K, M, _ = chain(4.0, 32)
    found = frequencies(K, M, [6 * i + direction for i in range(1, 33)])[:2]
    # A linear element's error is (βh)²/24: 1e-4 and 9e-4.
    assert found == pytest.approx(speed * np.pi / 8.0 * np.array([1.0, 3.0]), rel=1e-3)


@pytest.mark.parametrize("length", [0.4, 3.0])
def test_cantilever_tip_under_a_force_and_a_couple(length):
    K, _, section = chain(length, 3)
    force, couple = 1e5, 2e4
    load = np.zeros(len(K))
    load[-5], load[-1] = force, couple  # +y and about z
    tip = np.linalg.solve(K[6:, 6:], load[6:])[-6:]
    EI, kGA = E * section.second_moment, section.shear_coefficient * G * section.area
    assert tip[1] == pytest.approx(force * length**3 / (3 * EI) + force * length / kGA + couple * length**2 / (2 * EI))
    assert tip[5] == pytest.approx(force * length**2 / (2 * EI) + couple * length / EI)


def test_cantilever_in_the_other_plane_turns_the_other_way():
    K, _, section = chain(2.0, 3)
    load = np.zeros(len(K))
    load[-4] = 1e5  # +z
    tip = np.linalg.solve(K[6:, 6:], load[6:])[-6:]
    assert tip[2] > 0.0
    assert tip[4] == pytest.approx(-1e5 * 2.0**2 / (2 * E * section.second_moment))


def rigid_motion(places, translation, rotation):
    return np.concatenate([[*(translation + np.cross(rotation, place)), *rotation] for place in places])


vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)


@settings(max_examples=40)
@given(translation=vectors, rotation=vectors, length=st.floats(0.1, 10.0))
def test_a_rigid_motion_strains_nothing(translation, rotation, length):
    section = circular_section(DIAMETER, 0.3, NU)
    K = beam_stiffness(section, length, E, NU)
    motion = rigid_motion([np.zeros(3), np.array([length, 0.0, 0.0])], translation, rotation)
    assert np.abs(K @ motion).max() <= 1e-12 * np.abs(K).max() * max(1.0, length)


def test_a_rigid_motion_has_the_inertia_of_the_solid_tube():
    K, M, section = chain(2.0, 4)
    places = [np.array([x, 0.0, 0.0]) for x in np.linspace(-1.0, 1.0, 5)]
    mass = RHO * section.area * 2.0
    expected = {0: RHO * section.polar_moment * 2.0, 1: mass * 2.0**2 / 12 + RHO * section.second_moment * 2.0}
    for axis in range(3):
        unit = np.eye(3)[axis]
        moving = rigid_motion(places, unit, np.zeros(3))
        turning = rigid_motion(places, np.zeros(3), unit)
        assert moving @ M @ moving == pytest.approx(mass, rel=1e-12)
        assert turning @ M @ turning == pytest.approx(expected[min(axis, 1)], rel=1e-12)
    assert np.count_nonzero(scipy.linalg.eigvalsh(K, M) < 1e-3) == 6  # rad²/s²; the first bending mode has 1e6


@settings(max_examples=40)
@given(angles=st.tuples(*[st.floats(-np.pi, np.pi)] * 3))
def test_turned_is_a_rotation_of_the_element(angles):
    # Any rotation that brings x to the direction gives the same matrix: the section is round.
    R = Rotation.from_euler("xyz", angles).as_matrix()
    section = circular_section(DIAMETER, 0.3, NU)
    big = np.kron(np.eye(4), R)
    for matrix in (beam_stiffness(section, 0.7, E, NU), beam_mass(section, 0.7, RHO, E, NU)):
        found = along_direction(matrix, 3.0 * R[:, 0])
        assert np.abs(found - big @ matrix @ big.T).max() <= 1e-11 * np.abs(matrix).max()


@pytest.mark.parametrize("direction", [[1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 1, 0], [0, 0, -2]])
def test_turned_along_an_axis_keeps_the_eigenvalues(direction):
    K = beam_stiffness(circular_section(DIAMETER, 0.0, NU), 0.7, E, NU)
    found = np.linalg.eigvalsh(along_direction(K, np.array(direction, dtype=float)))
    assert found == pytest.approx(np.linalg.eigvalsh(K), abs=1e-12 * np.abs(K).max())


def test_shear_coefficients_of_cowper():
    assert circular_section(1.0, 0.0, 0.3).shear_coefficient == pytest.approx(0.886, abs=5e-4)  # his table
    thin = circular_section(1.0, 1.0 - 1e-7, 0.3).shear_coefficient
    assert thin == pytest.approx(2.0 * 1.3 / (4.0 + 3.0 * 0.3), rel=1e-6)  # his thin round tube


def test_section_of_a_tube():
    section = circular_section(0.5, 0.3, NU)
    assert section.area == pytest.approx(np.pi / 4 * (0.5**2 - 0.3**2))
    assert section.second_moment == pytest.approx(np.pi / 64 * (0.5**4 - 0.3**4))
    assert section.polar_moment == pytest.approx(np.pi / 32 * (0.5**4 - 0.3**4))
