"""Planetary stages: kinematics, phases, the torsional law at the carrier and its errors.

Sources: Willis' equation; rigid-body motion of sun, planets and carrier in the plane with a spring along every line of
action, solved as a linear system; places of teeth turned through the mesh; Parker and Lin, J. Mech. Des. 126 (2004)
525–534, for the harmonics that cancel (harmonic n of the torque remains where n z_s/N is a whole number). Tolerances
are rounding, except for reciprocals cut off at 200 harmonics (1e-9) and steps between 2048 parts of a cycle (2e-3).
"""

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_files import stage_of

from tbm_dynamics.mesh.error import composite_tolerances
from tbm_dynamics.mesh.ishikawa import mesh_stiffness
from tbm_dynamics.mesh.planetary import stage_law, tooth_stiffness
from tbm_dynamics.mesh.tooth import GearError

STEEL = (210e9, 0.3)
CYCLES = np.arange(256) / 256


def meshes(stage):
    try:
        stage.check()
    except GearError:
        return False
    return True


STAGES = [
    stage
    for degrees in (20.0, 22.5, 25.0)
    for sun in range(18, 40, 2)
    for planet in range(18, 40)
    for planets in (2, 3, 4, 5)
    if meshes(stage := stage_of(sun, planet, planets, degrees=degrees))
]
stages = st.sampled_from(STAGES)
REFERENCE, MOTOR_STAGE = stage_of(20, 25, 3), stage_of(20, 25, 3, module=0.0045, width=0.08)
IN_PHASE, OPPOSED = stage_of(21, 24, 3), stage_of(22, 24, 4)
some = pytest.mark.parametrize("stage", [REFERENCE, MOTOR_STAGE, IN_PHASE, OPPOSED, stage_of(24, 25, 2, degrees=25.0)])


def contacts(stage):
    """Of the N sun–planet, then the N planet–ring meshes: pitch point, centre of the planet, force on the planet.

    A sun driven counter-clockwise pushes a planet onwards and outwards, the ring's teeth push it onwards and inwards.
    """
    sun, planet, alpha = stage.module * stage.sun_teeth / 2, stage.module * stage.planet_teeth / 2, stage.pressure_angle
    for radius, sign in ((sun, 1.0), (sun + 2 * planet, -1.0)):
        for angle in 2 * np.pi * np.arange(stage.planets) / stage.planets:
            out, on = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
            yield radius * out, (sun + planet) * out, np.cos(alpha) * on + sign * np.sin(alpha) * out


def moment(at, force):
    return at[0] * force[1] - at[1] * force[0]


def compressions(stage):
    """Compression of the meshes per turn of sun, carrier, ring and planets, (2N, 3 + N).

    Velocities of the two bodies at the pitch point along the force on the planet.
    """
    n = stage.planets
    found = np.zeros((2 * n, 3 + n))
    for row, (point, centre, force) in enumerate(contacts(stage)):
        found[row, 0 if row < n else 2] = moment(point, force)
        found[row, 1] = -moment(centre, force)
        found[row, 3 + row % n] = -moment(point - centre, force)
    return found


def static(stage, springs, errors):
    """Turns of carrier and planets under unit torque at the carrier, and under none with errors; sun and ring held."""
    rows = compressions(stage)
    held = rows[:, [1, *range(3, 3 + stage.planets)]]
    stiffness = held.T @ (springs[:, None] * held)
    # Material in excess squeezes a mesh like an approach of the bodies.
    return (
        np.linalg.solve(stiffness, np.eye(1 + stage.planets)[0]),
        np.linalg.solve(stiffness, -held.T @ (springs * errors)),
    )


def wave(coefficients, cycles):
    n = np.arange(1, len(coefficients) // 2 + 1)
    angle = 2 * np.pi * np.outer(cycles, n)
    first = coefficients[0] if len(coefficients) % 2 else 0.0
    rest = coefficients[len(coefficients) % 2 :]
    return first + np.cos(angle) @ rest[0::2] + np.sin(angle) @ rest[1::2]


@some
def test_the_compressions_allow_the_free_motion_only(stage):
    # Motion without compression, ring at rest.
    rows = compressions(stage)
    free = np.delete(rows, 2, axis=1)
    motion = np.linalg.svd(free)[2][-1]
    assert free @ motion == pytest.approx(0.0, abs=1e-12)
    assert motion[0] / motion[1] == pytest.approx(stage.ratio)
    assert motion[2:] / motion[1] == pytest.approx(1.0 - stage.ring_teeth / stage.planet_teeth)


@some
def test_no_power_is_lost(stage):
    springs = np.linspace(1.0, 2.0, 2 * stage.planets)
    rows = compressions(stage)
    turns = static(stage, springs, 0 * springs)[0]
    forces = springs * (rows[:, [1, *range(3, 3 + stage.planets)]] @ turns)
    sun, carrier, ring = (rows.T @ forces)[:3]
    assert carrier == pytest.approx(1.0)
    assert sun == pytest.approx(-1.0 / stage.ratio)
    assert ring == pytest.approx(1.0 / stage.ratio - 1.0)
    assert (rows.T @ forces)[3:] == pytest.approx(0.0, abs=1e-12)


@some
def test_compliance_is_that_of_gears_on_springs(stage):
    sun, ring = tooth_stiffness(stage, *STEEL, CYCLES)
    found = [static(stage, np.append(s, r), np.zeros(2 * len(s)))[0][0] for s, r in zip(sun, ring, strict=True)]
    law = stage_law(stage, *STEEL, 200)
    assert law.compliance.shape == (401,)
    assert wave(law.compliance, CYCLES) == pytest.approx(np.array(found), rel=1e-9)


@settings(max_examples=30)
@given(stage=stages, harmonics=st.integers(1, 12))
def test_coefficients_are_those_of_the_exact_reciprocal(stage, harmonics):
    sun, ring = tooth_stiffness(stage, *STEEL, CYCLES)
    stiffness = stage.lever**2 * np.sum(1.0 / (1.0 / sun + 1.0 / ring), axis=1)
    law = stage_law(stage, *STEEL, harmonics)
    n = np.arange(1, harmonics + 1)
    expected = np.empty(1 + 2 * harmonics)
    angle = 2 * np.pi * np.outer(n, CYCLES)
    expected[0] = np.mean(1.0 / stiffness)
    expected[1::2] = 2.0 * np.mean(np.cos(angle) / stiffness, axis=1)
    expected[2::2] = 2.0 * np.mean(np.sin(angle) / stiffness, axis=1)
    assert law.compliance == pytest.approx(expected, abs=1e-9 * expected[0])


@settings(max_examples=30)
@given(stage=stages)
def test_teeth_keep_the_mean_of_the_formula(stage):
    phase = (np.arange(2048) + 0.5) / 2048
    for pair, found in zip((stage.sun_mesh, stage.ring_mesh), tooth_stiffness(stage, *STEEL, CYCLES), strict=True):
        expected = mesh_stiffness(pair, stage.face_width, *STEEL, phase).mean()
        assert found.mean(axis=0) == pytest.approx(np.full(stage.planets, expected), rel=1e-9)


def cycles_until(flank, target, pitch):
    """Mesh cycles, in [0, 1), until one of the flanks at `flank` + k `pitch`, one pitch a cycle, is at `target`."""
    return ((target - flank) / pitch) % 1.0


def same_phase(found, expected):
    return np.abs((np.asarray(found) - expected + 0.5) % 1.0 - 0.5).max() < 1e-9


@settings(max_examples=60)
@given(stage=stages)
def test_phases_from_the_places_of_the_teeth(stage):
    check_phases(stage, np.pi / stage.planet_teeth)


def check_phases(stage, thickness):
    """Hold the phases against teeth set in their places; `thickness` (rad) of a planet's tooth from flank to flank.

    Seen from the carrier the sun turns counter-clockwise, planets and ring clockwise; pitch points only.
    """
    sun, planet, ring = (2 * np.pi / z for z in (stage.sun_teeth, stage.planet_teeth, stage.ring_teeth))
    places = 2 * np.pi * np.arange(stage.planets) / stage.planets
    at_sun = np.array([cycles_until(0.0, place, sun) for place in places])
    assert same_phase(at_sun, stage.sun_phases)
    # A planet's flank that the sun pushes on looks counter-clockwise and is inside, half a turn from the ring, at
    # cycle `at_sun`; a thickness clockwise of it is the flank of the same tooth that pushes on the ring.
    pushing = places + np.pi + at_sun * planet - thickness
    at_ring = np.array([cycles_until(-p, -place, planet) for p, place in zip(pushing, places, strict=True)])
    assert same_phase(at_ring, stage.ring_phases + stage.ring_lag)
    # The ring's teeth, placed by planet 0 alone, must be where the other planets need them.
    first = at_ring[0] * ring
    assert same_phase([cycles_until(-first, -place, ring) for place in places], at_ring)


def shifted_stage(sun, planet, ring, shifts, **more):
    """Stage whose ring has the profile shift that lets its planets run with the sun, too."""
    alpha = np.radians(20.0)

    def distance(teeth, shift):
        value = involute(alpha) + 2 * np.tan(alpha) * shift / teeth
        angle = scipy.optimize.brentq(lambda a: involute(a) - value, 1e-3, 1.0)
        return teeth / 2 * np.cos(alpha) / np.cos(angle), angle

    wanted, at_sun = distance(sun + planet, sum(shifts))
    shift = scipy.optimize.brentq(lambda x: distance(ring - planet, x - shifts[1])[0] - wanted, shifts[1] - 0.45, 1.5)
    at_ring = distance(ring - planet, shift - shifts[1])[1]
    stage = stage_of(sun, planet, 3, ring=ring)
    return stage.model_copy(update={"profile_shift": (*shifts, shift), **more}), wanted, (at_sun, at_ring)


def involute(angle):
    return np.tan(angle) - angle


@pytest.mark.parametrize(("teeth", "shifts"), [((20, 24, 70), (0.3, 0.4)), ((19, 26, 71), (0.2, 0.1))])
def test_planets_with_profile_shift_fit_between_sun_and_ring(teeth, shifts):
    stage, distance, angles = shifted_stage(*teeth, shifts)
    stage.check()
    assert stage.centre_distance == pytest.approx(0.007 * distance)
    assert [stage.sun_mesh.working_angle, stage.ring_mesh.working_angle] == pytest.approx(angles)
    assert stage.lever / stage.ratio == pytest.approx(0.0035 * teeth[0] * np.cos(np.radians(20.0)))  # the sun's base
    # Of a planet's tooth, each half is as thick as at the pitch circle of its mesh.
    at_reference = (np.pi / 2 + 2 * shifts[1] * np.tan(np.radians(20.0))) / teeth[1] + involute(np.radians(20.0))
    check_phases(stage, 2 * at_reference - sum(involute(angle) for angle in angles))
    with pytest.raises(GearError, match=r"profile shifts: planets run with the sun at .* mm, with the ring at"):
        stage.model_copy(update={"profile_shift": (*shifts, 0.0)}).check()


def test_helical_planets_mesh_with_less_ripple():
    spur = stage_of(20, 25, 3)
    # Whole overlap: b sin β = π m_n, lines of contact of constant length.
    width = np.pi * spur.module / np.sin(np.radians(15.0))
    helical = spur.model_copy(update={"helix_angle_deg": 15.0, "face_width": width})
    law, plain = (stage_law(stage, *STEEL, 4).compliance for stage in (helical, spur))
    assert np.abs(law[1:]).max() < 1e-9 * law[0]
    assert np.abs(plain[1:]).max() > 1e-3 * plain[0]
    assert helical.lever == pytest.approx(
        45 * 0.007 / np.cos(np.radians(15.0)) * np.cos(np.arctan(np.tan(np.radians(20.0)) / np.cos(np.radians(15.0))))
    )


@pytest.mark.parametrize(("planet", "lag"), [(24, 0.5), (25, 0.0)])
def test_parity_of_the_planet(planet, lag):
    # Parker and Lin: γ_rs = ½ for an even number of planet teeth, 0 for an odd one.
    assert stage_of(20, planet, 2).ring_lag == lag


@some
def test_teeth_enter_ahead_of_the_pitch_point_by_the_path(stage):
    fine = (np.arange(2048) + 0.5) / 2048
    pairs = (stage.sun_mesh, stage.ring_mesh)
    lags = (stage.sun_phases, stage.ring_phases + stage.ring_lag)
    for pair, lag, found in zip(pairs, lags, tooth_stiffness(stage, *STEEL, fine), strict=True):
        for j in range(stage.planets):
            raw = mesh_stiffness(pair, stage.face_width, *STEEL, (fine - lag[j] + pair.pitch_phase) % 1.0)
            exact, rounded = np.fft.rfft(raw)[1:4], np.fft.rfft(found[:, j])[1:4]
            factor = np.sinc(np.arange(1, 4) / 13)
            assert np.abs(rounded - factor * exact).max() < 2e-3 * np.abs(exact).max()


@settings(max_examples=60)
@given(stage=stages)
def test_harmonics_that_cancel_between_the_planets(stage):
    compliance = stage_law(stage, *STEEL, 12).compliance
    size = np.hypot(compliance[1::2], compliance[2::2]) / compliance[0]
    cancelled = (np.arange(1, 13) * stage.sun_teeth) % stage.planets != 0
    assert np.all(size[cancelled] < 1e-12)
    if stage.sun_teeth % stage.planets:
        assert np.hypot(*stage_law(stage, *STEEL, 1).tooth_error) < 1e-15


def ripple(stage):
    """Peak-to-peak of the compliance over its mean: of one planet's path, and of the stage."""
    sun, ring = tooth_stiffness(stage, *STEEL, CYCLES)
    one = 1.0 / sun[:, 0] + 1.0 / ring[:, 0]
    law = stage_law(stage, *STEEL, 200)
    return np.ptp(one) / one.mean(), np.ptp(wave(law.compliance, CYCLES)) / law.compliance[0]


def test_planets_in_phase_ripple_like_one_and_others_even_it_out():
    one, all_of_them = ripple(IN_PHASE)
    assert all_of_them == pytest.approx(one, rel=1e-9)
    assert one > 0.2
    one, all_of_them = ripple(REFERENCE)
    assert all_of_them < 0.5 * one


def tooth_errors(stage, cycle):
    """Tooth-to-tooth error of the N sun–planet and N planet–ring meshes at a mesh phase, (2N,), m."""
    found = []
    lags = (stage.sun_phases, stage.ring_phases + stage.ring_lag)
    for pair, teeth, lag in zip(
        (stage.sun_mesh, stage.ring_mesh), (stage.sun_teeth, stage.planet_teeth), lags, strict=True
    ):
        tooth, _ = composite_tolerances(stage.module, stage.module * teeth, pair.contact_ratio, 6)
        found.append(tooth / 2 * np.sin(2 * np.pi * (cycle - lag + pair.pitch_phase)))
    return np.concatenate(found)


def mean_springs(stage):
    return np.concatenate([found.mean(axis=0) for found in tooth_stiffness(stage, *STEEL, CYCLES)])


@some
def test_tooth_error_turns_the_carrier(stage):
    law, springs = stage_law(stage, *STEEL, 1), mean_springs(stage)
    for cycle in (0.0, 0.15, 0.6):
        turned = static(stage, springs, tooth_errors(stage, cycle))[1][0]
        assert turned == pytest.approx(wave(law.tooth_error, np.array([cycle]))[0], rel=1e-9, abs=1e-18)


def test_planets_in_phase_have_the_tooth_error_of_one():
    law = stage_law(IN_PHASE, *STEEL, 1)
    cycles = np.arange(64) / 64
    one = [tooth_errors(IN_PHASE, cycle)[[0, 3]].sum() / IN_PHASE.lever for cycle in cycles]
    assert wave(law.tooth_error, cycles) == pytest.approx(np.array(one))
    assert np.ptp(one) > 1e-5


def test_planet_error_is_that_of_eccentric_planets():
    stage = REFERENCE
    law, springs = stage_law(stage, *STEEL, 1), mean_springs(stage)
    tooth, total = composite_tolerances(stage.module, stage.module * 25, stage.ring_mesh.contact_ratio, 6)
    for cycle in (0.0, 4.0, 11.3):
        errors = []
        for row, (_, centre, force) in enumerate(contacts(stage)):
            # Backwards and inwards, turning with the planet; where they start is golden.
            angle = 2 * np.pi * (cycle / 25 + row % 3 * (np.sqrt(5) - 1) / 2)
            out = centre / np.linalg.norm(centre)
            moved = np.sin(angle) * np.array([out[1], -out[0]]) - np.cos(angle) * out
            errors.append(-(total - tooth) / 2 * moved @ force)
        turned = static(stage, springs, np.array(errors))[1][0]
        assert turned == pytest.approx(wave(law.planet_error, np.array([cycle / 25]))[0], rel=1e-9)


@some
@pytest.mark.parametrize("turn", [0.0, 1.0, 2.5])
def test_run_out_of_sun_and_ring_does_not_turn_the_carrier(stage, turn):
    n, moved = stage.planets, 2e-5 * np.array([np.cos(turn), np.sin(turn)])
    errors = np.array([moved @ force for _, _, force in contacts(stage)])
    for part in (slice(0, n), slice(n, 2 * n)):
        one = np.zeros(2 * n)
        one[part] = errors[part]
        assert abs(static(stage, mean_springs(stage), one)[1][0]) < 1e-15


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_compliance_scales_with_width_and_module(factor):
    # Width stiffens, size by the square of the lever; two accuracy grades double the errors and leave the stiffness.
    plain = stage_law(REFERENCE, *STEEL, 4)
    wide = stage_law(stage_of(20, 25, 3, width=0.14 * factor), *STEEL, 4)
    big = stage_law(stage_of(20, 25, 3, module=0.007 * factor), *STEEL, 4)
    size = plain.compliance[0]
    assert wide.compliance == pytest.approx(plain.compliance / factor, abs=1e-12 * size)
    assert big.compliance == pytest.approx(plain.compliance / factor**2, abs=1e-12 * size)
    coarse = stage_law(stage_of(20, 25, 3, grade=8), *STEEL, 4)
    assert np.array_equal(coarse.compliance, plain.compliance)
    assert coarse.planet_error == pytest.approx(2.0 * plain.planet_error)
