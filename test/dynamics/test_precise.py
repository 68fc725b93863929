"""The precise exponential against scipy's Padé one, and the response to polynomial loads against an ODE solver.

Sources: scipy.linalg.expm, scipy.integrate.solve_ivp, the scalar closed form. Both exponentials lose about the
condition of the matrix times 1e-16; 1e-11 of the largest entry is 100 times what was seen.
"""

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from tbm_dynamics.integration.pairs import phi_functions
from tbm_dynamics.integration.precise import polynomial_response, precise_exponential


def stable(seed, n, stiffest):
    """Damped oscillators with frequencies over several decades, mixed by a random basis, (2n, 2n)."""
    random = np.random.default_rng(seed)
    frequencies = np.geomspace(1.0, stiffest, n)
    basis = scipy.linalg.qr(random.standard_normal((n, n)))[0]
    K = basis @ np.diag(frequencies**2) @ basis.T
    return np.block([[np.zeros((n, n)), np.eye(n)], [-K, -1e-3 * K - 0.1 * np.eye(n)]])


def close(actual, expected, tolerance):
    # T = I + Ta: a result far below 1 is as good as the identity it was added to.
    return np.abs(actual - expected).max() <= tolerance * max(1.0, np.abs(expected).max())


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 12), scale=st.floats(1e-6, 30.0))
def test_exponential_of_random_matrices(seed, n, scale):
    matrix = np.random.default_rng(seed).standard_normal((n, n))
    half, whole = precise_exponential(matrix, scale)
    assert close(whole, scipy.linalg.expm(scale * matrix), 1e-11)
    assert close(half, scipy.linalg.expm(scale / 2.0 * matrix), 1e-11)
    assert close(half @ half, whole, 1e-11)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 10), stiffest=st.floats(10.0, 1e5))
def test_exponential_of_stiff_damped_oscillators(seed, n, stiffest):
    # Displacements and velocities of the stiffest differ by its frequency: compare in scaled coordinates.
    H, step = stable(seed, n, stiffest), 1e-4
    scale = np.repeat([stiffest, 1.0], n)
    half, whole = precise_exponential(H, step)
    expected = scipy.linalg.expm(step * H)
    assert close(whole * np.outer(scale, 1.0 / scale), expected * np.outer(scale, 1.0 / scale), 1e-9)
    assert close(half @ half * np.outer(scale, 1.0 / scale), whole * np.outer(scale, 1.0 / scale), 1e-10)
    assert np.abs(np.linalg.eigvals(whole)).max() <= 1.0 + 1e-10


def test_exponential_of_nothing_and_of_a_nilpotent():
    half, whole = precise_exponential(np.zeros((3, 3)), 1.0)
    assert np.array_equal(half, np.eye(3))
    assert np.array_equal(whole, np.eye(3))
    shift = np.diag([1.0, 1.0], 1)
    half, whole = precise_exponential(shift, 2.0)  # 1, t, t²/2
    assert whole == pytest.approx(np.array([[1.0, 2.0, 2.0], [0.0, 1.0, 2.0], [0.0, 0.0, 1.0]]), rel=1e-14)
    assert half[0] == pytest.approx([1.0, 1.0, 0.5], rel=1e-14)


def test_a_small_increment_is_not_lost_beside_the_identity():
    half, whole = precise_exponential(np.array([[-1e-12]]), 1.0)
    assert whole[0, 0] - 1.0 == pytest.approx(-1e-12, rel=1e-3)  # the last digit of a number near 1
    assert half[0, 0] - 1.0 == pytest.approx(-0.5e-12, rel=1e-3)


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), free=st.booleans())
def test_response_to_a_polynomial_load(seed, free):
    random = np.random.default_rng(seed)
    H = stable(seed, 3, 200.0)
    if free:
        H[:, 0] = 0.0  # nothing depends on the first displacement: H is singular
    E, step = random.standard_normal((6, 2)), 5e-3
    v, u, w, y = random.standard_normal(6), *random.standard_normal((3, 2)) * [[1.0], [1e2], [1e4]]
    half, whole = polynomial_response(H, E, step)
    known = np.concatenate([v, u, w, y])
    solution = scipy.integrate.solve_ivp(
        lambda s, state: H @ state + E @ (u + w * s + y * s**2 / 2.0),
        (0.0, step),
        v,
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
        t_eval=[step / 2.0, step],
    ).y
    assert half @ known == pytest.approx(solution[:, 0], rel=1e-8, abs=1e-9)
    assert whole @ known == pytest.approx(solution[:, 1], rel=1e-8, abs=1e-9)


def test_response_of_a_point_mass_in_closed_form():
    # ẍ = u + w s + y s²/2: x = v₀ s + u s²/2 + w s³/6 + y s⁴/24
    H, E = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    half, whole = polynomial_response(H, E, 0.6)
    for response, s in ((half, 0.3), (whole, 0.6)):
        assert response[0] == pytest.approx([1.0, s, s**2 / 2, s**3 / 6, s**4 / 24], rel=1e-13)
        assert response[1] == pytest.approx([0.0, 1.0, s, s**2 / 2, s**3 / 6], rel=1e-13)


@settings(max_examples=15)
@given(size=st.floats(1e-9, 300.0), angle=st.floats(0.5 * np.pi, 1.5 * np.pi))
def test_phi_functions_against_the_exponential(size, angle):
    # The first row of exp of z above a chain of ones is 1, φ₁, φ₂, φ₃ of z (Al-Mohy and Higham, 2011).
    z = size * np.exp(1j * angle)
    chain = np.diag([1.0 + 0.0j] * 3, 1)
    chain[0, 0] = z
    assert phi_functions(np.array([z]))[:, 0] == pytest.approx(scipy.linalg.expm(chain)[0, 1:], rel=1e-11)
