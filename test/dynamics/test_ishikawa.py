"""Ishikawa's tooth stiffness against ISO 6336-1:2006, method B, and against the mesh it is used for.

ISO: q' = 0.04723 + 0.15551/z1 + 0.25791/z2 (mm·µm/N), c' = 0.8/q' (0.8: measured against computed), cγ = c'(0.75 ε +
0.25), for steel, 20° and no profile shift. The two models are different ones; 15 % is what the project asks for. For
20/40 teeth the project's reference gives 20.6 N/(mm·µm) against 19.2.
"""

import numpy as np
import pytest

from tbm_dynamics.mesh.geometry import InternalPair
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


@pytest.mark.parametrize("teeth", [(20, 40), (25, 50), (17, 60), (30, 30), (20, 80), (40, 40), (30, 90), (18, 54)])
def test_mean_stiffness_against_iso_6336(teeth):
    ratio, found = external_pair(*teeth)
    single = 0.8 / (0.04723 + 0.15551 / teeth[0] + 0.25791 / teeth[1])
    assert found == pytest.approx(single * (0.75 * ratio + 0.25), rel=0.15)


def test_the_reference_pair():
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


def test_two_pairs_carry_up_to_the_contact_ratio_less_one():
    pair = InternalPair(16, 152, 0.022, np.radians(25.0))
    phase = (np.arange(1000) + 0.5) / 1000
    stiffness = mesh_stiffness(pair, 0.4, 210e9, 0.3, phase)
    jumps = phase[np.flatnonzero(np.abs(np.diff(stiffness)) > 0.1 * stiffness.mean())]
    assert jumps == pytest.approx([pair.contact_ratio - 1.0], abs=2e-3)
    two = phase < pair.contact_ratio - 1.0
    assert stiffness[two].min() > stiffness[~two].max()
