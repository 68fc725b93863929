"""The eight indicators by hand.

Source: Table 3 and equation (5) of the paper, on signals whose root mean squares and peaks are known in closed form;
all to rounding.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid
from scipy.stats import norm

from tbm_dynamics import load_machine, simulate
from tbm_dynamics.indicators import INDICATORS, UNITS, expected_peaks, indicators

TIME = np.arange(1000) / 1000.0


def test_indicators_of_sines_have_closed_forms():
    # Whole periods: RMS of a + b sin is √(a² + b²/2).
    displacement = np.zeros((1000, 6))
    displacement[:, 0] = -3.0
    displacement[:, 1] = 4.0 * np.sin(2 * np.pi * 5.0 * TIME)
    displacement[:, 3] = 1.0 + 2.0 * np.cos(2 * np.pi * 7.0 * TIME)
    displacement[:, 2] = displacement[:, 4] = displacement[:, 5] = 1e6  # not asked for
    acceleration = np.zeros((1000, 6))
    acceleration[500, 0], acceleration[501, 0] = 5.0, -8.0
    acceleration[2, 1] = -7.0
    acceleration[3, 3] = 9.0
    acceleration[4, [2, 4, 5]] = 1e6
    force = np.array([[1.0, 5.0], [3.0, 5.0]])
    found = indicators(displacement, acceleration, force, 2.0)
    assert tuple(found) == INDICATORS
    assert list(found.values()) == pytest.approx([3.0, np.sqrt(8.0), np.sqrt(3.0), 8.0, 7.0, 9.0, 5.0, 2.0])
    # Equation (5): mesh 1 deviates by 1 and 1 from 2 (RMS 1), mesh 2 by 3 and 3 (RMS 3); their mean is 2.


def test_equation_5_averages_the_meshes_not_all_samples():
    force = np.array([[2.0, 2.0], [2.0, 10.0]])  # RMS 0 and √32
    found = indicators(np.zeros((2, 6)), np.zeros((2, 6)), force, 2.0)
    assert found["MF_Se"] == pytest.approx(np.sqrt(32.0) / 2.0)


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), scale=st.floats(1e-3, 1e3))
def test_they_scale_with_the_motion_and_do_not_see_its_sign(seed, scale):
    random = np.random.default_rng(seed)
    q, a, f = random.standard_normal((50, 6)), random.standard_normal((50, 6)), random.uniform(1.0, 2.0, (50, 3))
    one = np.array(list(indicators(q, a, f, 1.5).values()))
    other = np.array(list(indicators(-scale * q, -scale * a, scale * f, scale * 1.5).values()))
    assert other == pytest.approx(scale * one, rel=1e-12)


def test_a_response_uses_ring_first_pinion_and_the_static_share():
    machine = load_machine("dz101")
    response = simulate(machine, 0.02, seed=2)
    found = response.indicators()
    assert found["RDef_A"] == pytest.approx(np.sqrt(np.mean(response.displacement(8, "x") ** 2)))
    assert found["RDef_R"] == pytest.approx(np.sqrt(np.mean(response.displacement(8, "rx") ** 2)))
    assert found["PAcc_L"] == np.abs(response.acceleration(14, "y")).max()
    assert found["MF_M"] == response.mesh_force.max()
    share = 3.04e6 / (10 * 1.672 * np.cos(np.radians(25.0)))
    deviation = np.sqrt(np.mean((response.mesh_force - share) ** 2, axis=0))
    assert found["MF_Se"] == pytest.approx(deviation.mean())


def test_units_change_with_the_units_of_the_motion():
    # Lengths in another unit, times in another, forces in a third: each number changes by what its unit says.
    random = np.random.default_rng(0)
    q, a, f = random.standard_normal((50, 6)), random.standard_normal((50, 6)), random.uniform(1.0, 2.0, (50, 3))
    length, time, force = 1e3, 60.0, 1e-3
    along = np.array([length] * 3 + [1.0] * 3)
    one = indicators(q, a, f, 1.5)
    other = indicators(along * q, along * a / time**2, force * f, force * 1.5)
    factors = {"m": length, "rad": 1.0, "m/s²": length / time**2, "rad/s²": time**-2, "N": force}
    for name in INDICATORS:
        assert other[name] == pytest.approx(factors[UNITS[name]] * one[name])


def test_expected_peaks_are_those_of_the_exact_distribution():
    """Of white noise: the largest of n absolute normal values has the mean of ∫ 1 − (2Φ(x) − 1)ⁿ dx."""
    count, runs, generator = 2000, 300, np.random.default_rng(0)
    levels = np.linspace(0.0, 8.0, 4001)
    exact = trapezoid(1.0 - (2.0 * norm.cdf(levels) - 1.0) ** count, levels)
    motion = np.zeros((count, 6))
    found = []
    for _ in range(runs):
        motion[:, 0] = generator.standard_normal(count)
        found.append(expected_peaks(motion)["expected_PAcc_A"])
    assert np.mean(found) == pytest.approx(exact, rel=0.02)
    single = np.abs(generator.standard_normal((runs, count))).max(axis=1)
    assert np.std(found) < np.std(single), "one draw scatters more than the expectation of ten"
