"""Faults of a pinion and its teeth, against what is published of them.

Sources: a local fault of a tooth modulates the mesh once a turn of its shaft, so that every harmonic of the mesh has
sidebands spaced by the shaft's frequency (McFadden, Mech. Syst. Signal Process. 1 (1987) 173–183; Randall, J. Mech.
Des. 104 (1982) 259–267: an eccentric gear has the first pair of sidebands only, a local fault many of alike height);
FM4, the kurtosis of the signal without its regular part, is 3 for sound gears and grows with one damaged tooth
(Stewart, 1977).
Stiffness: thin slices of face width side by side (a share of the width is that share of the stiffness) and pairs of
teeth side by side, each with Ishikawa's.
"""

import numpy as np
import pytest
from machine_files import built, plain, small
from scipy.stats import kurtosis

from tbm_dynamics import Simulator
from tbm_dynamics.mesh.faults import ToothFault, lost_stiffness
from tbm_dynamics.mesh.geometry import InternalPair
from tbm_dynamics.mesh.ishikawa import mesh_stiffness, pair_stiffness

TEETH, PARTS = 16, 2048
PAIR = InternalPair(TEETH, 152, 0.022, np.radians(25.0))
STEEL = (0.40, 210e9, 0.3)
ALONG = (np.arange(TEETH * PARTS) + 0.5) / PARTS


def waves(drives):
    return built({**plain(), "drives": drives}).assemble().couplings.waves


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_a_crack_costs_its_share_while_its_tooth_is_in_mesh(share):
    lost = lost_stiffness(ToothFault(fault="crack", share=share), PAIR, *STEEL)
    own = pair_stiffness(PAIR, *STEEL, ALONG)
    away = 1.0 / 13  # the width of the rounding
    inside = (2 * away < ALONG) & (PAIR.contact_ratio - 2 * away > ALONG)
    assert lost[inside] == pytest.approx(share * own[inside], rel=0.02)
    outside = (PAIR.contact_ratio + 2 * away < ALONG) & (TEETH - 2 * away > ALONG)
    assert np.abs(lost[outside]).max() < 0.02 * share * own.max()
    assert lost.mean() == pytest.approx(share * own.mean(), rel=1e-9)


def test_pits_cost_stiffness_where_the_pitch_line_touches():
    lost = lost_stiffness(ToothFault(fault="pitting", share=0.3), PAIR, *STEEL)
    middle = np.abs(ALONG - PAIR.pitch_phase).argmin()
    assert ALONG @ lost / lost.sum() == pytest.approx(PAIR.pitch_phase, abs=0.03)
    assert lost[middle] == pytest.approx(0.3 * pair_stiffness(PAIR, *STEEL, ALONG[[middle]])[0], rel=0.05)
    assert np.abs(lost[np.abs(ALONG - PAIR.pitch_phase) > 0.5]).max() < 0.02 * lost[middle]


def test_a_missing_tooth_leaves_what_its_neighbours_carry():
    phases = (np.arange(PARTS) + 0.5) / PARTS
    sound = mesh_stiffness(PAIR, *STEEL, phases)
    scale = 8.1e9 / sound.mean()
    found = waves({1: {"tooth": {"fault": "missing"}}})
    stiffness = found.evaluate(np.concatenate([phases, phases + 1.0, phases + 2.0]))[0][:, 0].reshape(3, -1) / scale
    neighbours = [pair_stiffness(PAIR, *STEEL, phases + shift) for shift in (1.0, 0.0)]
    clear = np.abs(phases - (PAIR.contact_ratio - 1.0)) > 2 / 13
    clear &= (phases > 2 / 13) & (phases < 1 - 2 / 13)
    assert stiffness[0][clear] == pytest.approx(neighbours[0][clear], abs=0.03 * sound.max())
    assert stiffness[1][clear] == pytest.approx(neighbours[1][clear], abs=0.03 * sound.max())
    assert stiffness[2] == pytest.approx(found.evaluate(phases + 2.0)[0][:, 5] / scale, rel=1e-3)  # alike phases
    assert stiffness.min() > -0.02 * sound.max()


def test_factors_of_one_drive_change_its_mesh_alone():
    plain_waves, odd = (
        waves({}),
        waves({3: {"tooth_stiffness": 0.8, "misalignment": 0.5, "mesh_error": 2.0}, 7: {"eccentricity": 50e-6}}),
    )
    cycles = np.linspace(0.0, 16.0, 333)
    (k, e, _), (k_odd, e_odd, _) = plain_waves.evaluate(cycles), odd.evaluate(cycles)
    assert k_odd[:, 2] == pytest.approx(0.4 * k[:, 2], rel=1e-12)
    assert e_odd[:, 2] == pytest.approx(2.0 * e[:, 2], abs=1e-18)
    added = e_odd[:, 6] - e[:, 6]
    assert (added.max(), added.min()) == pytest.approx((50e-6, -50e-6), rel=1e-3)
    others = [i for i in range(20) if i not in (2, 6)]
    assert np.array_equal(k_odd[:, others], k[:, others])
    assert np.array_equal(e_odd[:, others], e[:, others])


@pytest.mark.parametrize("wedge", [60e-6, 150e-6, 400e-6])
def test_misalignment_is_what_thin_slices_in_contact_leave(wedge):
    # Slices of equal stiffness along the face, whose gap grows by `wedge` from one end to the other: ISO 6336-1's K_Hβ
    # is the largest load of a slice over the mean one, at least 2 where some do not touch.
    along = (np.arange(200_000) + 0.5) / 200_000

    def load(deflection):
        return 8.1e9 * np.maximum(deflection - wedge * along, 0.0)

    deflection = np.sqrt(2.0 * wedge * 200e3 / 8.1e9)  # under 200 kN
    assert load(deflection).mean() == pytest.approx(200e3, rel=1e-3)
    uneven = load(deflection).max() / load(deflection).mean()
    stiffness = (load(deflection + 1e-8) - load(deflection - 1e-8)).mean() / 2e-8
    assert uneven > 2.0
    found = waves({3: {"misalignment": 1.0 - 2.0 / uneven}}).mesh_stiffness
    assert found[[2, 3]] == pytest.approx([stiffness, 8.1e9], rel=1e-3)


TURN = 4000
"""Steps of a turn of the pinion at 0.4 s a turn."""


def one_turn(drives):
    """Mesh force of drive 1 over a turn of its pinion, the mean of five (n,), N; motors that soon calm the start."""
    data = small()
    data["driveshaft"]["motor"] = plain()["driveshaft"]["motor"]
    data["operating_point"]["speed_r_min"] = 150.0 * TEETH / 152
    del data["operating_limits"]
    system = built({**data, "drives": drives}).assemble()
    loads = np.tile(system.mean_load, (7 * TURN, 1))
    force = Simulator(system, (14,)).step(loads).mesh_force[2 * TURN :, 0]
    return force.reshape(5, TURN).mean(axis=0)


@pytest.fixture(scope="module")
def sound():
    return one_turn({})


def residual_kurtosis(turn):
    """FM4: kurtosis without the harmonics of the mesh, their first sidebands and the turn itself."""
    spectrum = np.fft.rfft(turn)
    for order in (0, 1, *(TEETH * m + side for m in range(1, TURN // 2 // TEETH) for side in (-1, 0, 1))):
        spectrum[order] = 0.0
    return kurtosis(np.fft.irfft(spectrum), fisher=False)


FAR = [order for order in range(3, 3 * TEETH - 2) if order % TEETH not in (0, 1, 2, TEETH - 1, TEETH - 2)]
FIRST = [TEETH * m + side for m in (1, 2) for side in (-1, 1)]


def added(turn, sound):
    """Amplitudes of the harmonics of the turn that a fault has added."""
    return 2.0 * np.abs(np.fft.rfft(turn - sound)) / TURN


@pytest.mark.parametrize("tooth", [{"fault": "crack", "share": 0.3}, {"fault": "pitting", "share": 0.5}], ids=str)
def test_one_bad_tooth_has_many_sidebands_and_an_impulse(sound, tooth):
    turn = one_turn({1: {"tooth": tooth}})
    lines = added(turn, sound)
    assert np.median(lines[FAR]) > 0.5 * lines[FIRST].mean() > 100.0  # N
    assert residual_kurtosis(turn) > 10.0 > 3.0 * residual_kurtosis(sound)


def test_an_eccentric_pinion_has_the_first_sidebands_only(sound):
    turn = one_turn({1: {"eccentricity": 100e-6}})
    lines = added(turn, sound)
    assert lines.argmax() == 1
    assert lines[FIRST].min() > 10.0 * np.median(lines[FAR])
    assert residual_kurtosis(turn) == pytest.approx(residual_kurtosis(sound), rel=0.05)
