"""A gear pair with backlash: softening resonance, jumps and lost contact.

Source: Kahraman and Singh, Non-linear dynamics of a spur gear pair, J. Sound Vib. 142 (1990): in times of 1/ω_n and
lengths of half the backlash b,

    ẍ + 2ζẋ + f(x) = F_m + F_a Ω² sin Ωt,   f(x) = x − 1, 0, x + 1 above, in and below the gap,

and their solution by harmonic balance: x = x_m + x_a sin(Ωt + φ), f by its describing functions. F_m = 0.1, F_a = 0.05,
ζ = 0.05 (a lightly loaded pair). Harmonic balance leaves out the higher harmonics, some 3 % of the amplitude here, more
at the end of the upper branch: 5 % on amplitudes, 0.05 on the frequency ratios where the branches end. Against scipy's
DOP853 on the paper's equation: 0.5 % of the motion at every instant, the first strikes from rest included (the load is
linear between steps: 0.04 % of it is lost).
"""

import numpy as np
import pytest
import scipy.integrate
import scipy.optimize
from gear_pair import HALF_GAP, NATURAL, STIFFNESS, gear_pair

from tbm_dynamics import Simulator

ZETA, MEAN, ALTERNATING = 0.05, 0.1, 0.05
STEP = 1e-4
PERIODS, KEPT = 80, 20  # 1 % of a transient is left after 15 periods


def sweep(ratios, method="reduced"):
    """(mean, amplitude of the first harmonic, share of the time without contact) while Ω goes through the ratios."""
    run = Simulator(gear_pair(ZETA, MEAN), (2,), STEP, method)
    phase, found = 0.0, []
    for ratio in ratios:
        turn = ratio * NATURAL * STEP
        steps, kept = (round(periods * 2.0 * np.pi / turn) for periods in (PERIODS, KEPT))
        phases = phase + turn * np.arange(1, steps + 1)
        phase = phases[-1]
        loads = np.zeros((steps, 6))
        loads[:, 3] = ALTERNATING * ratio**2 * STIFFNESS * HALF_GAP * np.sin(phases)
        chunk = run.step(loads)
        x = chunk.displacement[-kept:, 0, 3] / HALF_GAP
        window = 2.0 * np.hanning(kept)
        amplitude = 2.0 * abs(np.mean(window * x * np.exp(-1j * phases[-kept:])))
        found.append((np.mean(window * x), amplitude, np.mean(chunk.mesh_force[-kept:] == 0.0)))
    return np.array(found)


def kernel(u, inside, outside):
    """A describing function's piece: `inside` for |u| ≤ 1."""
    return inside(u) if abs(u) <= 1.0 else outside(u)


def g(u):
    return kernel(u, lambda v: 2.0 / np.pi * (v * np.arcsin(v) + np.sqrt(1.0 - v * v)), abs)


def h(u):
    return kernel(u, lambda v: 2.0 / np.pi * (np.arcsin(v) + v * np.sqrt(1.0 - v * v)), np.sign)


def harmonic_balance(amplitude):
    """Mean x_m and the frequency ratios (below, above) of an amplitude x_a; the ratios are nan where it is not met."""

    def ends(mean):
        return (1.0 - mean) / amplitude, (-1.0 - mean) / amplitude

    def surplus(mean):
        upper, lower = ends(mean)
        return mean + 0.5 * amplitude * (g(upper) - g(lower)) - MEAN

    mean = scipy.optimize.brentq(surplus, 0.0, 2.0)
    upper, lower = ends(mean)
    stiffness = 1.0 - 0.5 * (h(upper) - h(lower))
    # (N_a − W)² + 4ζ²W = (F_a W / x_a)², W = Ω²
    squares = np.roots([1.0 - (ALTERNATING / amplitude) ** 2, 4.0 * ZETA**2 - 2.0 * stiffness, stiffness**2])
    if np.iscomplex(squares).any():
        return mean, np.nan, np.nan
    return mean, *np.sqrt(np.sort(squares))


@pytest.fixture(scope="module")
def curve():
    """Amplitudes of harmonic balance with mean and ratios, (n, 4)."""
    return np.array([(a, *harmonic_balance(a)) for a in np.arange(0.06, 0.4, 1e-4)])


UPWARDS = np.arange(0.60, 1.151, 0.025)


@pytest.fixture(scope="module")
def upwards():
    return sweep(UPWARDS)


@pytest.fixture(scope="module")
def downwards():
    return sweep(UPWARDS[::-1])[::-1]


def jump(sweep):
    """Ratios between which the amplitude changes most."""
    place = np.abs(np.diff(np.log(sweep[:, 1]))).argmax()
    return UPWARDS[place], UPWARDS[place + 1]


def test_teeth_separate_and_amplitude_jumps_at_the_branch_ends(curve, upwards, downwards):
    below, above = curve[:, 2], curve[:, 3]
    # The lower branch bends back where its ratio is greatest, the upper one ends where the two ratios meet.
    end_of_lower, end_of_upper = np.nanmax(below), np.nanmin(above)
    assert end_of_lower - end_of_upper > 0.1
    assert jump(upwards)[0] - 0.02 < end_of_lower < jump(upwards)[1] + 0.02
    assert jump(downwards)[0] - 0.05 < end_of_upper < jump(downwards)[1]
    between = (jump(downwards)[1] < UPWARDS) & (jump(upwards)[0] > UPWARDS)
    assert between.sum() >= 2
    assert np.all(downwards[between, 1] > 3.0 * upwards[between, 1])
    assert np.all(upwards[between, 2] == 0.0)
    assert np.all(downwards[between, 2] > 0.4)


def test_amplitudes_on_both_branches(curve, upwards, downwards):
    lower = (jump(upwards)[0] > UPWARDS) & (UPWARDS > 0.66)  # the curve begins there
    upper = jump(downwards)[1] < UPWARDS
    closed = curve[:, 0] < 0.1 * (1.0 - 1e-3)  # while it never opens the system is linear and the balance exact
    ratios, amplitudes = curve[closed, 2], curve[closed, 0]
    linear = lower & (ratios[-1] > UPWARDS) & (ratios[0] < UPWARDS)
    assert linear.sum() >= 2
    assert upwards[linear, 1] == pytest.approx(np.interp(UPWARDS[linear], ratios, amplitudes), rel=1e-3)
    opened = np.isfinite(curve[:, 3]) & (curve[:, 0] > 0.1)
    ratios, amplitudes, means = curve[opened][::-1, 3], curve[opened][::-1, 0], curve[opened][::-1, 1]
    assert upper.sum() >= 12
    assert downwards[upper, 1] == pytest.approx(np.interp(UPWARDS[upper], ratios, amplitudes), rel=0.05)
    assert downwards[upper, 0] == pytest.approx(np.interp(UPWARDS[upper], ratios, means), rel=0.02)


@pytest.mark.parametrize("method", ["reduced", "full"])
@pytest.mark.parametrize("ratio", [0.775, 0.9, 1.1])
def test_every_instant_against_an_ode_solver(method, ratio):
    run = Simulator(gear_pair(ZETA, MEAN), (2,), STEP, method)
    time = np.arange(round(60 * 2.0 * np.pi / (ratio * NATURAL * STEP))) * NATURAL * STEP
    loads = np.zeros((len(time), 6))
    loads[:, 3] = alternating(ratio, time) * STIFFNESS * HALF_GAP
    chunk = run.step(loads)
    x = chunk.displacement[:, 0, 3] / HALF_GAP
    assert (chunk.mesh_force == 0.0).mean() > 0.2

    def right(t, y):
        force = np.sign(y[0]) * max(abs(y[0]) - 1.0, 0.0)
        return [y[1], MEAN + alternating(ratio, t) - 2.0 * ZETA * y[1] - force]

    start = [1.0 + MEAN, 0.0]
    exact = scipy.integrate.solve_ivp(right, (0.0, time[-1]), start, "DOP853", t_eval=time, rtol=1e-9, atol=1e-11)
    assert np.abs(x - exact.y[0]).max() < 5e-3 * np.ptp(exact.y[0])


def alternating(ratio, time):
    """F_a Ω² sin Ωt, stronger at first, so that the upper branch is reached."""
    return (1.0 + 2.0 * np.exp(-((0.03 * ratio * time) ** 2))) * ALTERNATING * ratio**2 * np.sin(ratio * time)
