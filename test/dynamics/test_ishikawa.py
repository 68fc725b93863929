"""Ishikawa's tooth stiffness against ISO 6336-1:2006, method B, and against the mesh it is used for.

ISO: c' = 0.8 C_B/q' (0.8: measured against computed), q' a series in 1/z and the profile shifts x, z2 → ∞ for a ring,
C_B = (1 + 0.5 (1.2 − 1.25)) (1 − 0.02 (20° − α)) for a basic rack with a dedendum of 1.25 modules, and
cγ = c'(0.75 ε + 0.25), for steel. `iso_stiffness` is held against the two spur stages of the NREL 5 MW gearbox that
github.com/gfsReboucas/Drivetrain-python publishes (tests/data/nrel_5mw_matlab_gear_geometry.json): c', cγ and the mesh
stiffness k, there 1.85 b cγ (ISO's cγα and cγβ = 0.85 cγα together). Its contact ratios ε, of shifted profiles, are
found to 1e-4: its centre distances are whole millimetres. Ishikawa's mean lies 41 and 24 % above its cγ.

Ishikawa's mean stiffness lies above ISO's: external pairs by 9 to 15 % at 20° and 20 to 24 % at 25°, a pinion in its
ring by 16 to 19 % at 20° and 11 to 13 % at 25°. The project asks for 15 %, so external pairs at 25° and rings at 20°
miss it. `PAIRS` holds each deviation, to 0.5 % either way.

What makes them stiff is the contact. Ishikawa's flattening, 4 (1 − ν²)/(π E b), is 0.0056 mm·µm/N whatever the load. A
line contact pressed together between the centre lines of two teeth yields by 2 (1 − ν²)/(π E b) (2 ln(2d/a) −
ν/(1 − ν)) per force, a half the width of the contact and d the depth (Weber and Banaschek 1953; Johnson, Contact
Mechanics, section 5.6): at 300 N/mm and module 5 mm 0.016 to 0.020 mm·µm/N, a quarter to a third of what a pair yields
where it is stiffest. With this in the place of Ishikawa's and nothing else changed, all pairs lie between −8 and +2 %,
the second deviation in `PAIRS`; at 100 N/mm between −12 and −2 %, at 1000 N/mm between −5 and +7 %. The model keeps
Ishikawa's term: the formula is the paper's, and no load belongs to it.
"""

import numpy as np
import pytest

from tbm_dynamics.mesh import ishikawa
from tbm_dynamics.mesh.geometry import ExternalPair, InternalPair
from tbm_dynamics.mesh.ishikawa import contact_compliance, iso_flexibility, mesh_stiffness, tooth_compliance
from tbm_dynamics.mesh.tooth import Tooth

ANGLE, MODULE, WIDTH, STEEL = np.radians(20.0), 0.005, 0.02, (206e9, 0.3)
LOAD = 300e3  # N/m

# Kind, teeth, pressure angle (degrees), deviation from ISO, the same with a line contact under LOAD.
PAIRS = [
    (ExternalPair, (20, 40), 20.0, 0.099, -0.072),
    (ExternalPair, (25, 25), 20.0, 0.106, -0.064),
    (ExternalPair, (20, 60), 20.0, 0.106, -0.068),
    (ExternalPair, (30, 90), 20.0, 0.140, -0.041),
    (ExternalPair, (18, 54), 20.0, 0.100, -0.073),
    (ExternalPair, (20, 25), 20.0, 0.091, -0.075),
    (ExternalPair, (25, 50), 20.0, 0.117, -0.058),
    (ExternalPair, (17, 60), 20.0, 0.101, -0.073),
    (ExternalPair, (30, 30), 20.0, 0.122, -0.053),
    (ExternalPair, (20, 80), 20.0, 0.111, -0.065),
    (ExternalPair, (40, 40), 20.0, 0.148, -0.033),
    (InternalPair, (25, 70), 20.0, 0.176, -0.006),
    (InternalPair, (20, 70), 20.0, 0.164, -0.021),
    (InternalPair, (30, 90), 20.0, 0.189, 0.006),
    (ExternalPair, (20, 40), 25.0, 0.205, -0.012),
    (ExternalPair, (25, 25), 25.0, 0.221, 0.002),
    (ExternalPair, (20, 60), 25.0, 0.208, -0.012),
    (ExternalPair, (30, 90), 25.0, 0.242, 0.015),
    (ExternalPair, (18, 54), 25.0, 0.197, -0.019),
    (InternalPair, (16, 152), 25.0, 0.131, -0.071),
    (InternalPair, (25, 70), 25.0, 0.109, -0.066),
    (InternalPair, (20, 70), 25.0, 0.106, -0.076),
    (InternalPair, (30, 90), 25.0, 0.123, -0.053),
]


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


def iso_stiffness(teeth, ratio, degrees, shifts=(0.0, 0.0)):
    """ISO's c' and cγ, N/(mm·µm)."""
    single = 0.8 / (iso_flexibility(*teeth, shifts) * 1e9) * 0.975 * (1.0 - 0.02 * (20.0 - degrees))
    return single, single * (0.75 * ratio + 0.25)


def deviation_from_iso(pair):
    """Mean stiffness over ISO's cγ less 1."""
    teeth = (pair.pinion_teeth, pair.wheel_teeth if isinstance(pair, ExternalPair) else np.inf)
    return mean_stiffness(pair) / iso_stiffness(teeth, pair.contact_ratio, np.degrees(pair.pressure_angle))[1] - 1.0


def line_contact(pair):
    """Compression between the centre lines of two teeth that touch in the pitch point, times width over force, m²/N."""
    poisson, modulus = STEEL[1], STEEL[0] / (1.0 - STEEL[1] ** 2)
    wheel = pair.wheel_pitch_radius if isinstance(pair, ExternalPair) else -pair.ring_pitch_radius
    radius = np.sin(pair.pressure_angle) / (1.0 / pair.pinion_pitch_radius + 1.0 / wheel)
    half_width = np.sqrt(8.0 * LOAD * radius / (np.pi * modulus))
    depth = np.pi / 4.0 * pair.module / np.cos(pair.pressure_angle)
    return 2.0 / (np.pi * modulus) * (2.0 * np.log(2.0 * depth / half_width) - poisson / (1.0 - poisson))


@pytest.mark.parametrize(
    ("teeth", "shifts", "width", "ratio", "single", "mean", "published", "above"),
    [
        ((19, 17), (0.617, 0.802), 491, 1.114698962948295, 14.686762000041444, 15.95017927789633, 1.448835e10, 0.412),
        ((18, 36), (0.389, 0.504), 550, 1.3703997308907856, 14.19506877983275, 18.138456021852434, 1.845588e10, 0.243),
    ],
)
def test_iso_6336_of_two_published_stages(teeth, shifts, width, ratio, single, mean, published, above):
    found = iso_stiffness(teeth, ratio, 20.0, shifts)
    assert found == pytest.approx((single, mean), rel=1e-12)
    pair = ExternalPair(*teeth, MODULE, ANGLE, 0.0, *shifts)
    assert pair.contact_ratio == pytest.approx(ratio, rel=1.1e-4)
    assert mean_stiffness(pair) / mean - 1.0 == pytest.approx(above, abs=0.005)
    assert found[1] * 1.85 * width * 1e6 == pytest.approx(published, rel=4e-7)


@pytest.mark.parametrize(("kind", "teeth", "degrees", "deviation", "with_line_contact"), PAIRS)
def test_mean_stiffness_against_iso_6336(monkeypatch, kind, teeth, degrees, deviation, with_line_contact):
    pair = kind(*teeth, MODULE, np.radians(degrees))
    assert deviation_from_iso(pair) == pytest.approx(deviation, abs=0.005)
    monkeypatch.setattr(ishikawa, "contact_compliance", lambda width, *_: line_contact(pair) / width)
    assert deviation_from_iso(pair) == pytest.approx(with_line_contact, abs=0.005)


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


def test_the_reference_pair_has_its_published_stiffness():
    assert mean_stiffness(ExternalPair(20, 40, MODULE, ANGLE)) == pytest.approx(20.6, abs=0.05)
    assert external_pair(20, 40)[1] == pytest.approx(20.6, abs=0.05)


def test_a_tooth_yields_more_towards_its_tip():
    tooth = Tooth(16, 0.022, np.radians(25.0))
    compliance = tooth_compliance(tooth, np.linspace(tooth.form_radius, 0.999 * tooth.tip_radius, 50), 0.4, *STEEL)
    assert np.all(compliance > 0.0)
    assert np.all(np.diff(compliance) > 0.0)


@pytest.mark.parametrize("scale", [0.5, 3.0])
def test_stiffness_scales_with_width_and_elasticity_not_size(scale):
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
