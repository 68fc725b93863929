"""Natural frequencies that others published, by the assembler and the mesh rows of the machines.

**Planetary gears in the plane.** Lin and Parker, Analytical characterization of the unique properties of planetary gear
free vibration, J. Vib. Acoust. 121 (1999): `LIN_PARKER`, to the last digit but for `LIN_PARKER_MISSED`, 0.04 % at most,
where an independent computation finds what is found here. Cooley and Parker, Vibration properties of high-speed
planetary gears with gyroscopic effects, J. Vib. Acoust. 134 (2012), at standstill: `COOLEY_PARKER`, in √(k_p/m_p), to
the digits. Both name I/r², α and the stiffness, on which alone the frequencies depend. The gearboxes of a machine are
condensed to one torsional law a stage (`mesh.planetary`): its compliance is held against these bodies on rigid pins.

**Torsion of a planetary gear**, ring held. Kahraman, Natural modes of planetary gear trains, J. Sound Vib. 173 (1994):
ω² = 0, (k_r + k_s)/m_p (n − 1 times) and the roots of λ₁x² + λ₂x + λ₃ with λ₁ = m_p m_c m_s, λ₂ = −[n k_s m_p m_c +
(k_r + k_s)(m_c m_s + n m_p m_s)], λ₃ = n k_r k_s (n m_p + m_c + 4 m_s). Bodies as I/r², of the carrier with the planets
on it and r the pins' distance times cos α, which the equations of motion give. Tolerance: rounding.

**Geared torsion.** Friswell, Penny, Garvey and Lees, Dynamics of Rotating Machines (2010), examples of chapter 9 and
9.6.3, 9.7.1: `FRISWELL`, to the last digit. Teeth and the pinion's bearings do not yield.

**A wind turbine.** NREL 5 MW (Jonkman et al., NREL/TP-500-38060, 2009): drive shaft 867.637e6 N·m/rad, generator
534.116 kg·m² at 97 times the rotor's speed; rotor 57 231 535 kg·m², of a published two-mass model. Published: 2.18 Hz
free-free; free-fixed 0.6205 (FAST) and 0.6094 (ADAMS), which bend more than the shaft: two inertias alone have 0.6197,
0.13 and 1.7 % from them. NREL 750 kW reference gearbox (NREL/TP-5000-51885, 2011): 99/39/21, 82/23, 88/22 teeth, ratio
81.491.

**A geared rotor in another code**, ROSS 3.0.0: shafts, bodies, bearings and a mesh, all 54 frequencies of
`reference/geared_rotor.json`, up to 18 kHz. Both codes take Cowper's shear and consistent masses: 1e-9, rounding.
"""

import numpy as np
import pytest
from geared_rotor import described, our_frequencies
from machine_files import built, small
from published_parts import CARRIER, RING, SUN, Planetary, assembler_of, frequencies, turning_parts

from tbm_dynamics.mesh.geometry import ExternalPair
from tbm_dynamics.mesh.planetary import stage_law, tooth_stiffness
from tbm_dynamics.structure.drive import drive_unit

LIN_PARKER = {  # rotational, translational (in pairs), planet (N − 3 times), Hz
    3: ([0, 1475.7, 1930.3, 2658.3, 7462.8, 11775.3], [743.2, 1102.4, 1896.0, 2276.4, 6986.3, 9647.9], []),
    4: (
        [0, 1536.6, 1970.6, 2625.7, 7773.6, 13071.1],
        [727.0, 1091.0, 1892.8, 2342.5, 7189.9, 10437.6],
        [1808.2, 5963.8, 6981.7],
    ),
    5: (
        [0, 1567.4, 2006.1, 2614.8, 8065.4, 14253.1],
        [710.0, 1072.0, 1888.1, 2425.3, 7382.4, 11172.3],
        [1808.2, 5963.8, 6981.7],
    ),
}
LIN_PARKER_MISSED = {727.0: 0.3, 1091.0: 0.2, 1536.6: 0.1}  # of N = 4, by how much
COOLEY_PARKER = ([0.9296, 1.090, 1.358, 1.931, 5.566, 7.741], [0.7432, 1.018, 1.265, 1.487, 4.976, 6.282])


def spectrum(planets, rotational, pairs, planet=()):
    return np.sort(np.concatenate([rotational, np.repeat(pairs, 2), np.repeat(planet, planets - 3)]))


@pytest.mark.parametrize("planets", [3, 4, 5])
def test_lin_and_parkers_planetary_gear(planets):
    gear = Planetary(planets, 24.6, (0.4, 2.35, 5.43, 0.66), (0.39, 3.0, 6.29, 0.61))
    for node, turning in ((SUN, 0.0), (RING, 1e9), (CARRIER, 0.0)):
        gear.bear(node, 1e8, turning)
    gear.pin(1e8)
    found = frequencies(gear.parts.M, gear.stiffness(5e8), gear.in_the_plane())
    for value, published in zip(found, spectrum(planets, *LIN_PARKER[planets]), strict=True):
        assert value == pytest.approx(published, abs=LIN_PARKER_MISSED.get(published, 0.051))


def test_cooley_and_parkers_planetary_gear_at_standstill():
    gear = Planetary(3, 20.0, (3.0, 7.64, 12.0, 1.86), (1.75, 8.09, 6.80, 1.25))
    for node, stiffness, turning in ((SUN, 20e6, 20e6), (RING, 100e6, 100e6), (CARRIER, 50e6, 100e6)):
        gear.bear(node, stiffness, turning)
    gear.pin(10e6)
    found = frequencies(gear.parts.M, gear.stiffness(100e6), gear.in_the_plane())
    in_units = found * 2.0 * np.pi / np.sqrt(10e6 / 1.86)
    assert in_units == pytest.approx(spectrum(3, *COOLEY_PARKER), abs=5e-4)


@pytest.mark.parametrize("planets", [3, 4, 5])
def test_kahramans_torsional_modes(planets):
    gear = Planetary(planets, 22.0, (1.0, 1.0, 3.0, 0.5), (0.4, 1.0, 6.0, 0.6))
    n, sun, ring, (m_s, _, carrier, m_p) = planets, 3e8, 5e8, (0.4, 1.0, 6.0, 0.6)
    m_c = (carrier + n * 0.5) / np.cos(np.radians(22.0)) ** 2
    springs = np.repeat([sun, ring], n)
    free = gear.turning(SUN, CARRIER)
    found = frequencies(gear.parts.M, gear.stiffness(springs), free, gear.pinned())
    middle = -(n * sun * m_p * m_c + (ring + sun) * (m_c * m_s + n * m_p * m_s))
    roots = np.roots([m_p * m_c * m_s, middle, n * ring * sun * (n * m_p + m_c + 4.0 * m_s)])
    expected = np.sqrt(np.sort([0.0, *[(ring + sun) / m_p] * (n - 1), *roots])) / (2.0 * np.pi)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-2)


def test_a_stages_law_is_that_of_its_bodies_on_rigid_pins():
    gear = Planetary(3, 20.0, (1.0,) * 4, (1.0,) * 4)
    sun, ring = tooth_stiffness(gear.stage, 210e9, 0.3, np.arange(16) / 16)
    waves = np.exp(2j * np.pi * np.outer(np.arange(16) / 16, np.arange(201)))
    law = stage_law(gear.stage, 210e9, 0.3, 200).compliance
    series = waves.real[:, 0] * law[0] + waves.real[:, 1:] @ law[1::2] + waves.imag[:, 1:] @ law[2::2]
    free = gear.turning(CARRIER)
    rigid = gear.pinned()[:, free]
    for at_sun, at_ring, expected in zip(sun, ring, series, strict=True):
        K = gear.stiffness(np.concatenate([at_sun, at_ring]))[np.ix_(free, free)]
        whole = np.block([[K, rigid.T * 1e9], [rigid * 1e9, np.zeros((len(rigid), len(rigid)))]])
        assert np.linalg.inv(whole)[0, 0] == pytest.approx(expected, rel=1e-6)


def friswell_branched_rotor():
    pair = ExternalPair(20, 20, 0.01, np.radians(20.0))
    bodies = {1: (400e-6, 0.0), 2: (25e-6, 0.0)} | {
        node: (inertia, pair.centre_distance) for node, inertia in ((3, 25e-6), (4, 700e-6), (5, 700e-6))
    }
    parts = turning_parts(bodies, [(1, 2, 10e3), (3, 4, 5e3), (3, 5, 5e3)])
    return parts, [parts.mesh_row(2, 3, pair, np.pi)]


def friswell_twin_propulsion():
    # The propeller's gear drives one wheel on either side of it; shafts without mass.
    pair = ExternalPair(25, 40, 0.04, np.radians(20.0))
    side = pair.centre_distance
    places = {1: (-2.5, 0, 0), 2: (0, 0, 0), 3: (0, side, 0), 4: (0, -side, 0), 5: (3.5, side, 0), 6: (3.5, -side, 0)}
    parts = assembler_of(places, 176.8e9, 68e9)
    for node, inertia in ((1, 3200.0), (2, 400.0), (3, 800.0), (4, 800.0), (5, 450.0), (6, 450.0)):
        parts.add_body(node, 1.0, (inertia, 1.0, 1.0))
    parts.add_shaft((1, 2), 0.2, 0.0, 1e-9)
    for wheel, engine in ((3, 5), (4, 6)):
        parts.add_shaft((wheel, engine), 0.25, 0.0, 1e-9)
    return parts, [parts.mesh_row(2, 3, pair, np.pi), parts.mesh_row(2, 4, pair, 0.0)]


def friswell_engine():
    bodies = {node: (inertia, 0.0) for node, inertia in enumerate((3.5e-3, 3.5e-3, 3.5e-3, 0.15, 0.05), start=1)}
    return turning_parts(bodies, [(1, 2, 12e3), (2, 3, 12e3), (3, 4, 14e3), (4, 5, 10e3)]), []


FRISWELL = [  # Hz, half of the last digit
    (friswell_branched_rotor, [0.0, 425.4, 634.1, 3247.2], 0.05),
    (friswell_twin_propulsion, [0.0, 10.304, 20.479, 24.423], 5e-4),
    (friswell_engine, [0.0, 81.21, 141.21, 378.95, 536.36], 5e-3),
]


@pytest.mark.parametrize(("example", "expected", "digit"), FRISWELL)
def test_friswells_geared_torsion(example, expected, digit):
    parts, rigid = example()
    turning = np.arange(3, len(parts.M), 6)
    assert frequencies(parts.M, parts.K, turning, rigid) == pytest.approx(expected, abs=1.01 * digit)


def test_nrel_5_mw_drive_train():
    data = small()
    drive = data["driveshaft"]
    drive.pop("motor", None)
    drive["gear"].update(pinion_teeth=20, ring_teeth=97)
    drive["pinion_shaft"]["mass"], drive["gearbox_output"]["inertia"][0] = 1e-6, 1e-6
    drive["rotor"]["inertia"][0] = 534.116
    # 4.85 at the ring, 4 and 5 in the stages: 97.
    for stage, planet in zip(drive["gearbox"]["stages"], (20, 30), strict=True):
        stage.update(sun_teeth=20, planet_teeth=planet, ring_teeth=20 + 2 * planet, planets=4)
    unit = drive_unit(built(data).description)
    front, mesh, rear, output, rotor, ring = range(3, 36, 6)
    stiff = np.zeros((3, len(unit.M)))
    for row, (first, second) in zip(stiff, ((front, mesh), (mesh, rear), (rear, output)), strict=True):
        row[first], row[second] = 1.0, -1.0
    M, K = unit.M.copy(), 867.637e6 / 4.85**2 * np.outer(unit.rows[1], unit.rows[1])
    M[ring, ring] += 57_231_535.0
    rigid = [unit.rows[0], *stiff]
    shafts = [ring, front, mesh, rear, output]
    assert frequencies(M, K, [*shafts, rotor], rigid) == pytest.approx([0.0, 2.181], abs=5e-4)
    assert frequencies(M, K, shafts, rigid) == pytest.approx([0.6197], abs=5e-5)


def test_nrel_750_kw_gearbox_ratio():
    gear = Planetary(3, 20.0, (1.0,) * 4, (1.0,) * 4, teeth=(21, 39))
    assert gear.stage.ring_teeth == 99
    # Turns of sun and carrier without compression of a mesh, ring held; then from shaft to shaft.
    free = gear.turning(SUN, CARRIER)
    rows = np.vstack([gear.meshes, gear.pinned()])[:, free]
    sun, carrier = np.linalg.svd(rows)[2][-1][:2]
    ratio = sun / carrier
    for wheel, pinion in ((82, 23), (88, 22)):
        pair = ExternalPair(wheel, pinion, 0.01, np.radians(20.0))
        parts = assembler_of({1: (0, 0, 0), 2: (0, pair.centre_distance, 0)})
        row = parts.mesh_row(1, 2, pair, np.pi)
        ratio *= -row[3] / row[9]
    assert ratio == pytest.approx(81.491, abs=5e-4)


def test_the_whole_spectrum_of_a_geared_rotor_in_ross():
    data = described()
    found = our_frequencies(data)
    assert len(found) == 54
    assert found == pytest.approx(np.array(data["frequencies_hz"]), rel=1e-9, abs=1e-3)  # abs: of the free rotation
