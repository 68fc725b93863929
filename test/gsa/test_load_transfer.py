"""Band powers under loads of unknown level, their scatter, and the factors found from them.

Sources: scipy's filters and Welch's method on signals with a known answer, numpy's solution of the full matrices,
time runs, scipy's optimiser, and draws from the laws that are claimed.
"""

import numpy as np
import pytest
import scipy.optimize
import scipy.signal
from numpy.random import default_rng

from tbm_dynamics import Machine, Simulator, load_machine
from tbm_dynamics.integration import DEFAULT_STEP
from tbm_dynamics.loads.density import load_density
from tbm_dynamics.loads.description import COMPONENTS, LOAD_GROUPS, LoadFactors
from tbm_dynamics.machine.description import MachineDescription
from tbm_gsa.explanation.band_reading import BandReading, Sensor
from tbm_gsa.explanation.load_posterior import MODULATION_ERROR, NOISE_ERROR, BandObservation, load_posterior
from tbm_gsa.explanation.load_scatter import LoadScatter, effective_duration, load_scatter
from tbm_gsa.explanation.load_transfer import load_transfer, machine_motion
from tbm_gsa.signals.band_weights import band_weights
from tbm_gsa.signals.conditioning import common_band
from tbm_gsa.signals.reduction import SignalReducer
from tbm_gsa.signals.settings import Settings
from tbm_msgs_py.base.errors import InputError

POINTS = ("cutterhead", "shield", "walkway", "girder", "gripper")
BANDS = load_machine("dz101").description.loads.bands
READING = BandReading({point: Sensor() for point in POINTS}, BANDS)
NAMES = [statistic.name for statistic in READING.statistics]
START_S = 2.0  # of a run, left out
ROCK = np.array([2.0, 0.6, 1.6, 1.0, 0.7, 1.5])
# Excited by the loads themselves, as few others: what the meshes add or move from band to band is below 2 %.
DIRECT = [
    NAMES.index(f"rms_{band}_hz_{point}_{axis}")
    for point in ("cutterhead", "shield")
    for band, axis in (("0.5-20", "x"), ("125-135", "x"), ("0.5-20", "y"), ("100-110", "y"), ("125-135", "z"))
]


@pytest.fixture(scope="module")
def motion(machine):
    return machine_motion(machine, READING)


@pytest.fixture(scope="module")
def scatter(motion):
    return load_scatter(motion)


def band_powers(machine, seed, duration, reading=READING):
    """Band powers of a run, its start left out."""
    nodes = [machine.description.test_points[point] for point in reading.sensors]
    simulator, loads = Simulator(machine.assemble(), nodes), machine.loads(seed)
    reducers = [SignalReducer(reading.rate_hz, reading.band, "fixed", Settings()) for _ in nodes]
    for first in range(0, round((START_S + duration) / DEFAULT_STEP), 10_000):
        time = np.arange(first, first + 10_000) * DEFAULT_STEP
        values = simulator.step(loads.evaluate(time)).acceleration
        if time[0] >= START_S:
            for place, reducer in enumerate(reducers):
                reducer.feed(time - START_S, np.ascontiguousarray(values[:, place, :3]))
    return reading.of({point: reducer.finish() for point, reducer in zip(reading.sensors, reducers, strict=True)})


def draws(scatter, factors, noise, duration, count, seed=0):
    """Band powers drawn from the law that is claimed: chance, and the errors of what meshes add and of the noise."""
    expected = scatter.expected(factors, noise)
    errors = (
        MODULATION_ERROR * np.square(factors) @ scatter.transfer.modulated / expected,
        NOISE_ERROR * scatter.width * noise / expected,
    )
    covariance = scatter.covariance(factors, noise, duration) + np.diag(np.square(errors).sum(axis=0))
    logs = default_rng(seed).multivariate_normal(np.zeros(len(noise)), covariance, count, method="eigh")
    return expected * np.exp(logs - 0.5 * np.diag(covariance))


@pytest.mark.parametrize("frequency", [0.9, 4.3, 99.6, 100.05, 109.9, 130.3, 399.0])
@pytest.mark.parametrize("segment_s", [1.0, 4.0])
def test_a_line_shows_in_the_bands_as_scipy_s_welch_has_it(frequency, segment_s):
    rate, bands = 1000.0, ((0.5, 20.0), (100.0, 110.0), (125.0, 135.0), (0.0, 500.0))
    time, band = np.arange(80_000) / rate, common_band(rate)
    values = np.sqrt(2.0) * np.cos(2.0 * np.pi * frequency * time + 0.3)
    once = np.vstack(
        [
            scipy.signal.butter(2, band.low, "highpass", fs=rate, output="sos"),
            scipy.signal.butter(4, band.high, fs=rate, output="sos"),
        ]
    )
    conditioned = scipy.signal.sosfiltfilt(once, values)[20_000:-20_000]
    bins, density = scipy.signal.welch(conditioned, rate, nperseg=round(segment_s * rate), detrend=False)
    expected = [density[(bins >= low) & (bins < high)].sum() * bins[1] for low, high in bands]
    found = band_weights(np.array([frequency]), band, rate, bands, segment_s)[:, 0]
    # Below a bin's width the line's mirror image at the negative frequency falls into the bins as well.
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=0.02 if frequency * segment_s < 2.0 else 1e-6)


def test_gains_are_those_of_the_full_matrices(machine, motion):
    system, density = machine.assemble(), load_density(machine.description.loads)
    inside = np.flatnonzero((density.frequency > 124.0) & (density.frequency < 136.0))[::32]
    omega = 2.0 * np.pi * density.frequency[inside, None, None]
    dynamic = system.K + 1j * omega * system.C - omega**2 * system.M
    force = np.zeros((len(inside), system.size, 1))
    force[:, system.load_dofs[0]] = 1.0
    node = machine.description.test_points["cutterhead"]
    answer = np.abs(omega[:, 0, 0] ** 2 * np.linalg.solve(dynamic, force)[:, system.dof(node, "ux"), 0]) ** 2
    region, line = machine.description.loads.fx.regions[1], machine.description.loads.fx.lines[1]
    weight = READING.weights(density.frequency[inside])[2]
    noise = np.sum(answer * weight * density.noise[1, inside, 0]) * 0.5
    at_line = np.interp(line.frequency, density.frequency[inside], answer)
    found = motion.transfer().gain[LOAD_GROUPS.index("axial_high"), NAMES.index("rms_125-135_hz_cutterhead_x")]
    assert region.band == (125.0, 135.0)
    assert found == pytest.approx(noise + at_line * line.amplitude**2 / 2.0, rel=0.02)


def test_a_factor_counts_by_its_square(machine, motion):
    transfer = motion.transfer()
    assert transfer.predict(np.ones((2, 6))).shape == (2, len(NAMES))
    np.testing.assert_allclose(transfer.predict(np.zeros(6)), transfer.meshes)
    for group in range(6):
        one, two = np.zeros((2, 6))
        one[group], two[group] = 1.0, 2.0
        np.testing.assert_allclose(
            transfer.predict(two) - transfer.meshes, 4.0 * transfer.gain[group], rtol=1e-6, atol=1e-20
        )
        np.testing.assert_allclose(transfer.predict(one) - transfer.meshes, transfer.gain[group], rtol=1e-6, atol=1e-20)
    # The transfer is that at a factor of 1, whatever the machine's are.
    louder = load_transfer(machine.with_inputs(**{"loads.axial_low": 2.0}), READING)
    np.testing.assert_allclose(louder.gain, transfer.gain)


def test_a_doubled_factor_quadruples_its_part_of_a_run(machine):
    reading = BandReading({"girder": Sensor()}, bands=((0.5, 20.0),))
    louder = machine.with_inputs(**{"loads.axial_low": 2.0})
    one, two = (band_powers(each, 3, 4.0, reading)[0] for each in (machine, louder))
    # Along the axis the meshes of a symmetric machine do nothing, so the runs differ by leakage alone.
    assert two == pytest.approx(4.0 * one, rel=1e-5)


def test_a_run_is_within_the_scatter_of_the_prediction(machine, scatter):
    quiet = np.zeros(len(NAMES))
    powers = band_powers(machine.with_inputs(**dict(zip(factor_names(), ROCK, strict=True))), 11, 8.0)
    left = np.log(powers / scatter.expected(ROCK, quiet))[DIRECT]
    covariance = scatter.covariance(ROCK, quiet, 8.0)[np.ix_(DIRECT, DIRECT)]
    assert np.all(np.abs(left) < 4.0 * np.sqrt(np.diag(covariance)))
    misfit = left @ np.linalg.solve(covariance + 0.02**2 * np.eye(len(left)), left)
    assert misfit < scipy.stats.chi2.isf(1e-4, len(left))


def factor_names():
    return [f"loads.{group}" for group in LOAD_GROUPS]


def test_teeth_move_a_line_to_where_a_run_has_it():
    # A tenth of the variation, so that the second order is 1 %; one line of one component, no error of the teeth.
    raw = load_machine("dz101").base.model_dump()
    raw["driveshaft"]["mesh"].update(variation=0.1, error_factor=0.0)
    for name in COMPONENTS:
        raw["loads"][name].update(regions=(), lines=())
    raw["loads"]["fz"]["lines"] = ({"frequency": 130.3, "amplitude": 8e5, "source": "test"},)
    machine = Machine(MachineDescription.model_validate(raw))
    shift = machine.mesh_frequency
    bands = tuple((130.3 + sign * shift - 1.3, 130.3 + sign * shift + 1.3) for sign in (-1.0, 1.0))
    reading = BandReading({"cutterhead": Sensor(), "girder": Sensor()}, bands=bands)
    transfer = load_transfer(machine, reading)
    sides = [place for place, one in enumerate(reading.statistics) if one.axis == "z"]
    moved = transfer.modulated.sum(axis=0) / transfer.predict(np.ones(6))
    assert np.all(moved[sides] > 0.99)
    np.testing.assert_allclose(
        band_powers(machine, 1, 4.0, reading)[sides], transfer.predict(np.ones(6))[sides], rtol=0.02
    )


@pytest.mark.verify
@pytest.mark.parametrize(("inputs", "factors"), [({}, np.ones(6)), ({}, ROCK), ({"x16": 0.7}, np.ones(6))])
def test_runs_have_the_mean_and_the_scatter_predicted(machine, inputs, factors):
    changed = machine.with_inputs(**inputs, **dict(zip(factor_names(), factors, strict=True)))
    found, quiet, count = load_scatter(machine_motion(changed, READING)), np.zeros(len(NAMES)), 16
    logs = np.log([band_powers(changed, seed, 30.0) for seed in range(count)])[:, DIRECT]
    left = logs - np.log(found.expected(factors, quiet)[DIRECT])
    size = np.sqrt(np.diag(found.covariance(factors, quiet, 30.0)))[DIRECT]
    assert np.all(np.abs(left.mean(axis=0)) < 4.0 * size / np.sqrt(count) + 0.03)
    spread = left.std(axis=0, ddof=1) / size
    low, high = np.sqrt(scipy.stats.chi2.ppf([1e-4, 1.0 - 1e-4], count - 1) / (count - 1))
    assert np.all((spread > low) & (spread < high))


def test_the_scatter_of_white_noise_is_that_of_scipy_s_welch(scatter):
    rate, segment, duration, count = 512.0, 4.0, 20.0, 300
    noise = default_rng(5).standard_normal((count, round(duration * rate)))
    bins, density = scipy.signal.welch(noise, rate, nperseg=round(segment * rate), detrend=False)
    powers = density[:, (bins >= 100.0) & (bins < 110.0)].sum(axis=1) * bins[1]
    expected = np.sqrt(1.0 / (10.0 * effective_duration(duration, segment)))
    # 300 draws: a standard deviation within 4 %.
    assert np.log(powers).std() == pytest.approx(expected, rel=0.12)
    # In the quietest statistic of a machine with sensors far above it, nothing but their noise is left.
    still, loud = np.zeros(6), np.full(len(NAMES), 1e3)
    place = NAMES.index("rms_100-110_hz_gripper_x")
    assert np.sqrt(scatter.covariance(still, loud, duration)[place, place]) == pytest.approx(expected, rel=0.03)
    assert scatter.width[place] == pytest.approx(10.0, rel=1e-3)


def test_sensors_that_lose_packets_have_less_in_common(scatter):
    # Powers of segments (χ², two degrees of freedom) that two sensors share, each with losses of its own.
    rng, count, seen = default_rng(2), 30, (20, 12)
    segments = rng.exponential(size=(20_000, count))
    kept = [rng.permuted(np.tile(np.arange(count) < each, (len(segments), 1)), axis=1) for each in seen]
    means = [(segments * mask).sum(axis=1) / mask.sum(axis=1) for mask in kept]
    common = np.cov(segments.mean(axis=1), ddof=0)
    expected = np.cov(means, ddof=0) / common
    points = np.array([one.point for one in scatter.transfer.statistics])
    share = np.where(points == "cutterhead", seen[0] / count, seen[1] / count)
    whole, part = (scatter.covariance(ROCK, np.zeros(len(NAMES)), 1e6, coverage) for coverage in (None, share))
    pair = [NAMES.index(f"rms_125-135_hz_{point}_x") for point in ("cutterhead", "gripper")]
    found = part[np.ix_(pair, pair)] / whole[np.ix_(pair, pair)]
    np.testing.assert_allclose(found, expected, rtol=0.05)
    assert np.linalg.eigvalsh(part / np.sqrt(np.outer(np.diag(part), np.diag(part))))[0] > -1e-9


@pytest.mark.parametrize("density", [0.0, 1e-7])
def test_covariances_are_symmetric_and_positive(scatter, density):
    found = scatter.covariance(ROCK, np.full(len(NAMES), density), 30.0)
    np.testing.assert_allclose(found, found.T)
    size = np.sqrt(np.diag(found) + 1e-18)
    assert np.linalg.eigvalsh(found / np.outer(size, size))[0] > -1e-9


def test_a_recording_shorter_than_a_segment_is_refused(scatter):
    with pytest.raises(InputError, match=r"recording of 3 s, allowed: at least a segment of 4 s"):
        scatter.covariance(ROCK, np.zeros(len(NAMES)), 3.0)


def test_a_point_that_the_machine_has_not_is_refused(machine):
    with pytest.raises(InputError, match="test point 'roof': machine dz101 has cutterhead, shield"):
        machine_motion(machine, BandReading({"roof": Sensor()}, BANDS))


def test_a_sensor_off_the_axis_feels_the_torque(machine):
    on, off = (
        load_transfer(machine, BandReading({"cutterhead": Sensor(offset=(0.0, 0.0, height))}, BANDS))
        for height in (0.0, 2.0)
    )
    group, side = (
        LOAD_GROUPS.index("torsion_high"),
        [s.name for s in on.statistics].index("rms_125-135_hz_cutterhead_y"),
    )
    assert on.gain[group, side] < 1e-9 * off.gain[group, side]


def test_a_turning_sensor_shows_both_directions_together(machine, motion):
    fixed = motion.transfer().gain[:, : 3 * 4].reshape(6, 3, 4)
    turning = load_transfer(machine, BandReading({"cutterhead": Sensor("rotating")}, BANDS))
    assert [s.axis for s in turning.statistics[::4]] == ["x", "yz"]
    np.testing.assert_allclose(turning.gain[:, 4:], fixed[:, 1] + fixed[:, 2])


NOISE = np.full(len(NAMES), (100e-6 * 9.81) ** 2)


def test_the_posterior_is_the_optimum_that_scipy_finds(scatter):
    (powers,) = draws(scatter, ROCK, NOISE, 30.0, 1)
    found = load_posterior(BandObservation(powers, NOISE, 30.0), scatter, LoadFactors())
    factor = np.linalg.cholesky(np.linalg.inv(found.scatter))

    def left(theta):
        expected = scatter.expected(np.exp(theta), NOISE)[found.used]
        shift = found.residual - np.log(powers[found.used] / scatter.expected(found.factors, NOISE)[found.used])
        return np.concatenate([factor.T @ (np.log(powers[found.used] / expected) + shift), theta / np.log(2.0)])

    best = scipy.optimize.least_squares(left, np.zeros(6))
    np.testing.assert_allclose(found.log_factors, best.x, atol=1e-4)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(best.jac.T @ best.jac), rtol=1e-2, atol=1e-4)


def test_changed_rock_is_found_and_leaves_a_chi_square(scatter):
    found = [
        load_posterior(BandObservation(powers, NOISE, 30.0), scatter, LoadFactors(), model_error=0.0)
        for powers in draws(scatter, ROCK, NOISE, 30.0, 20, seed=1)
    ]
    seen = np.flatnonzero(found[0].learnt > 0.5)
    assert [LOAD_GROUPS[place] for place in seen] == ["axial_low", "axial_high", "lateral", "moments"]
    inside = np.array([(one.interval[seen, 0] < ROCK[seen]) & (ROCK[seen] < one.interval[seen, 1]) for one in found])
    assert inside.mean() == pytest.approx(0.9, abs=0.1)  # 80 intervals
    ratios = np.array([one.misfit / one.freedom for one in found])
    assert ratios.mean() == pytest.approx(1.0, abs=0.2)
    assert min(one.surprise for one in found) > 1e-6


def test_no_level_of_the_loads_explains_a_softer_rock(machine, scatter):
    softer: LoadScatter = load_scatter(machine_motion(machine.with_inputs(x16=0.7), READING))
    for powers in draws(softer, np.ones(6), NOISE, 30.0, 4):
        observed = BandObservation(powers, NOISE, 30.0)
        wrong, right = (load_posterior(observed, each, LoadFactors()) for each in (scatter, softer))
        assert wrong.surprise < 1e-6 < right.surprise
        assert right.log_evidence - wrong.log_evidence > 10.0


def test_a_recording_of_nothing_but_noise_says_nothing(scatter):
    with pytest.raises(InputError, match="no band power above the sensors' noise"):
        load_posterior(BandObservation(scatter.width * NOISE, NOISE, 30.0), scatter, LoadFactors())
