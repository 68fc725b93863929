"""How large a change must be: against normal theory from scipy, and the joint information matrix written out."""

import numpy as np
import pytest
from scipy.stats import norm

from tbm_gsa.explanation.detection import Detection

U, N, M, SIGMA = 12, 4, 3, 0.7


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((U, U))
    return rng.standard_normal((N, U)), root @ root.T + np.eye(U), rng.standard_normal((M, U))


def test_one_statistic_is_a_test_from_the_book():
    found = Detection.of(np.array([[2.0]]), np.array([[0.09]]), np.zeros((0, 1)), 1.0)
    expected = (norm.ppf(0.975) + norm.ppf(0.9)) * 0.3 / 2.0
    assert found.smallest(0.05, 0.9)[0] == pytest.approx(expected, rel=0.01)


def test_several_tests_share_their_false_findings():
    found = Detection.of(np.eye(5), np.eye(5), np.zeros((0, 5)), 1.0)
    assert found.limit(0.05) == pytest.approx(norm.ppf(0.5 + 0.5 * 0.95**0.2), rel=0.01)  # Šidák
    alike = Detection.of(np.ones((5, 5)), np.eye(5), np.zeros((0, 5)), 1.0)
    assert alike.limit(0.05) == pytest.approx(norm.ppf(0.975), rel=0.01)


def test_information_is_what_the_nuisances_leave(problem):
    slopes, chance, nuisances = problem
    found, inverse = Detection.of(slopes, chance, nuisances, SIGMA), np.linalg.inv(chance)
    for slope, information in zip(slopes, found.information, strict=True):
        rows = np.vstack([slope, nuisances])
        joint = rows @ inverse @ rows.T + np.diag([0.0, *[SIGMA**-2] * M])
        assert information == pytest.approx(1.0 / np.linalg.inv(joint)[0, 0])


@pytest.mark.parametrize("sigma", [1e-9, 1e6])
def test_four_times_the_length_halves_a_change(problem, sigma):
    """Exact where the loads are known, or not known at all."""
    slopes, chance, nuisances = problem
    once, longer = (Detection.of(slopes, part, nuisances, sigma).smallest(0.05, 0.9) for part in (chance, chance / 4.0))
    np.testing.assert_allclose(longer, once / 2.0, rtol=2e-3)


def test_a_longer_recording_never_hides_a_change(problem):
    slopes, chance, nuisances = problem
    lengths = [Detection.of(slopes, chance / t, nuisances, SIGMA).information for t in (1.0, 2.0, 10.0, 1e4)]
    assert (np.diff(lengths, axis=0) > 0.0).all()


def test_what_does_nothing_is_never_found(problem):
    slopes, chance, nuisances = problem
    found = Detection.of(np.vstack([slopes, np.zeros(U), -3.0 * slopes[0], nuisances[0]]), chance, nuisances, SIGMA)
    assert found.smallest(0.05, 0.9)[N] == np.inf
    assert found.correlation[0, N + 1] == pytest.approx(-1.0)
    assert found.correlation[0, N] == 0.0
    free = Detection.of(nuisances[:1], chance, nuisances, 1e6)
    assert free.smallest(0.05, 0.9)[0] > 1e3  # what the loads do as well


def test_bits_are_the_logarithm_of_what_is_left_of_the_prior(problem):
    slopes, chance, nuisances = problem
    prior = np.array([0.1, 0.5, 1.0, 2.0])
    spread = chance + SIGMA**2 * nuisances.T @ nuisances
    posterior = np.linalg.inv(np.diag(prior**-2) + slopes @ np.linalg.inv(spread) @ slopes.T)
    expected = 0.5 * np.log2(np.prod(prior**2) / np.linalg.det(posterior))
    assert Detection.of(slopes, chance, nuisances, SIGMA).bits(prior) == pytest.approx(expected)
