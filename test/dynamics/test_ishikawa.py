"""Ishikawa's tooth stiffness against ISO 6336-1:2006, method B, and against the mesh it is used for.

ISO: q' = 0.04723 + 0.15551/z1 + 0.25791/z2 (mm·µm/N), z2 → ∞ for a ring, c' = 0.8/q' C_B (0.8: measured against
computed; C_B = (1 + 0.5 (1.2 − 1.25)) (1 − 0.02 (20° − α)), the basic rack with a dedendum of 1.25 modules),
cγ = c'(0.75 ε + 0.25), for steel and no profile shift. The two models are different ones; 15 % is what the project asks
for. For 20/40 teeth the project's reference gives 20.6 N/(mm·µm) against 19.2.

The target is met by the pairs at 20°, with C_B and without it, and by the pinion in its ring at 25°. It is missed,
always to the stiff side, by external pairs at 25° (20 to 24 %: ISO's C_B grows by 2 % a degree, Ishikawa's trapezoid
by more) and by planets in a ring at 20° (16 to 19 %). These cases are marked as failing.
"""

import numpy as np
import pytest

from tbm_dynamics.mesh.geometry import ExternalPair, InternalPair
from tbm_dynamics.mesh.ishikawa import Tooth, contact_compliance, mesh_stiffness, tooth_compliance

ANGLE, MODULE, WIDTH, STEEL = np.radians(20.0), 0.005, 0.02, (206e9, 0.3)


def external_pair(z1, z2):
    """Contact ratio and mean mesh stiffness per width, N/(mm·µm), of an external pair."""
    first, second = Tooth(z1, MODULE, ANGLE), Tooth(z2, MODULE, ANGLE)
    pitch, line = np.pi * MODULE * np.cos(ANGLE), (z1 + z2) * MODULE / 2 * np.sin(ANGLE)
    ends = [np.sqrt(tooth.tip_radius**2 - tooth.base_radius**2) for tooth in (first, second)]
    ratio = (sum(ends) - line) / pitch
    along = np.linspace(line - ends[1], ends[0], 20_001)[1:-1]
    compliance = contact_compliance(WIDTH, *STEEL)
    compliance = compliance + tooth_compliance(first, np.hypot(first.base_radius, along), WIDTH, *STEEL)
    compliance = compliance + tooth_compliance(second, np.hypot(second.base_radius, line - along), WIDTH, *STEEL)
    # Pairs follow each other at one base pitch: the mean over a cycle is the integral over the path.
    return ratio, ratio * np.mean(1.0 / compliance) / WIDTH / 1e9


PHASES = (np.arange(4096) + 0.5) / 4096


def mean_stiffness(pair):
    """Mean over the mesh cycle per width, N/(mm·µm)."""
    return mesh_stiffness(pair, WIDTH, *STEEL, PHASES).mean() / WIDTH / 1e9


def deviation_from_iso(pair):
    """Mean stiffness over ISO's cγ less 1, with and without the factor of the basic rack."""
    wheel = pair.wheel_teeth if isinstance(pair, ExternalPair) else np.inf
    single = 0.8 / (0.04723 + 0.15551 / pair.pinion_teeth + 0.25791 / wheel)
    rack = 0.975 * (1.0 - 0.02 * (20.0 - np.degrees(pair.pressure_angle)))
    return mean_stiffness(pair) / (single * (0.75 * pair.contact_ratio + 0.25) * np.array([rack, 1.0])) - 1.0


@pytest.mark.parametrize(
    "teeth",
    [(20, 40), (25, 25), (20, 60), (30, 90), (18, 54), (20, 25), (25, 50), (17, 60), (30, 30), (20, 80), (40, 40)],
)
def test_mean_stiffness_against_iso_6336(teeth):
    assert np.abs(deviation_from_iso(ExternalPair(*teeth, MODULE, ANGLE))).max() < 0.15


@pytest.mark.parametrize("teeth", [(16, 152), (25, 70)])
def test_mean_stiffness_inside_a_ring_against_iso_6336(teeth):
    assert abs(deviation_from_iso(InternalPair(*teeth, MODULE, np.radians(25.0)))[0]) < 0.15


@pytest.mark.xfail(strict=True, reason="stiffer than ISO by more than 15 %, see above")
@pytest.mark.parametrize(
    ("kind", "teeth", "degrees"),
    [
        *((ExternalPair, teeth, 25.0) for teeth in [(20, 40), (25, 25), (20, 60), (30, 90), (18, 54)]),
        *((InternalPair, teeth, 20.0) for teeth in [(25, 70), (20, 70), (30, 90)]),
    ],
)
def test_mean_stiffness_against_iso_6336_out_of_reach(kind, teeth, degrees):
    assert abs(deviation_from_iso(kind(*teeth, MODULE, np.radians(degrees)))[0]) < 0.15


@pytest.mark.parametrize("teeth", [(20, 40), (25, 25), (30, 90), (40, 20)])
def test_an_external_mesh_is_its_path_of_contact(teeth):
    pair = ExternalPair(*teeth, MODULE, ANGLE)
    ratio, mean = external_pair(*teeth)
    assert pair.contact_ratio == pytest.approx(ratio)
    assert mean_stiffness(pair) == pytest.approx(mean, rel=5e-4)  # 4096 parts around two steps


@pytest.mark.parametrize("teeth", [(20, 40), (25, 25), (30, 90)])
def test_wheel_driving_runs_through_the_mesh_backwards(teeth):
    forwards, backwards = (ExternalPair(*z, MODULE, ANGLE) for z in (teeth, teeth[::-1]))
    expected = mesh_stiffness(forwards, WIDTH, *STEEL, PHASES)
    mirrored = (forwards.contact_ratio - PHASES) % 1.0
    assert mesh_stiffness(backwards, WIDTH, *STEEL, mirrored) == pytest.approx(expected, rel=1e-9)


def test_the_reference_pair():
    assert mean_stiffness(ExternalPair(20, 40, MODULE, ANGLE)) == pytest.approx(20.6, abs=0.05)
    assert external_pair(20, 40)[1] == pytest.approx(20.6, abs=0.05)


def test_a_tooth_yields_more_towards_its_tip():
    tooth = Tooth(16, 0.022, np.radians(25.0))
    compliance = tooth_compliance(tooth, np.linspace(tooth.form_radius, 0.999 * tooth.tip_radius, 50), 0.4, *STEEL)
    assert np.all(compliance > 0.0)
    assert np.all(np.diff(compliance) > 0.0)


@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_stiffness_is_proportional_to_width_and_elasticity_and_free_of_size(scale):
    tooth, big = Tooth(16, 0.022, 0.4), Tooth(16, 0.022 * scale, 0.4)
    radius = np.linspace(tooth.form_radius, 0.99 * tooth.tip_radius, 5)
    plain = tooth_compliance(tooth, radius, 0.4, *STEEL)
    assert tooth_compliance(tooth, radius, 0.4 * scale, *STEEL) == pytest.approx(plain / scale)
    assert tooth_compliance(tooth, radius, 0.4, 206e9 * scale, 0.3) == pytest.approx(plain / scale)
    assert tooth_compliance(big, radius * scale, 0.4, *STEEL) == pytest.approx(plain)


@pytest.mark.parametrize(
    "pair", [InternalPair(16, 152, 0.022, np.radians(25.0)), ExternalPair(20, 25, 0.007, np.radians(20.0))]
)
def test_two_pairs_carry_up_to_the_contact_ratio_less_one(pair):
    phase = (np.arange(1000) + 0.5) / 1000
    stiffness = mesh_stiffness(pair, 0.4, 210e9, 0.3, phase)
    jumps = phase[np.flatnonzero(np.abs(np.diff(stiffness)) > 0.1 * stiffness.mean())]
    assert jumps == pytest.approx([pair.contact_ratio - 1.0], abs=2e-3)
    two = phase < pair.contact_ratio - 1.0
    assert stiffness[two].min() > stiffness[~two].max()
