"""Motion of gear pairs that is known exactly or that others computed, by both methods of integration.

**Loss of contact**, exact: a mass on a flank that only pushes, held to it by a constant force that presses it in by δ,
swings with an amplitude of a δ (a > 1) at ω/ω_n = π/[π − arccos(1/a) + √(a² − 1)]: `LOST_CONTACT`, to 6e-5 in 109 to
212 steps a period.

**Parametric instability.** ẍ + 2ζω₀ẋ + ω₀²(1 + ε cos Ωt)x = 0 (Nayfeh and Mook, Nonlinear Oscillations, 1979, chapter
5): near Ω = 2ω₀ it grows where ε > 4ζ, within ω₀√(ε²/4 − 4ζ²) either side, there as exp(ω₀(ε/4 − ζ)t), all to first
order in ε. Rates to 0.1 %, for ε = 0.1, whose square is left out; ends of the instability within 5 % of its width.
Undamped the ends are the characteristic values a₁ and b₁ of Mathieu's equation (of scipy.special, exact): a motion from
rest at the greatest stiffness has turned to its opposite after one cycle of the teeth, here to 1e-6.

**A pair of two flanks with backlash** on bearings, a case of ROSS's tests (test_multi_rotor.py of version 3.0.0, model
after Yi et al., Mech. Syst. Signal Process. 132 (2019) 18–34): z 20/20, m 10 mm, b 30 mm, 20°, 6.57 kg, bearings 1e8
N/m and 512.64 N·s/m, mesh ε E b/18 with ± 0.275 of it as a rectangle, ζ_m 0.07, half gap 5e-5 m, error 2e-5 m, torque
300 + 100 sin ωt N·m on both, 1000 r/min. Means of ROSS over five turns from rest:

| | ROSS | here | tolerance, and why not closer |
| --- | --- | --- | --- |
| mesh force, N | 3191.996 | 3192.47 | 0.02 %: 300 N·m/r_b is 3192.53; ROSS's first turn is its start |
| mesh stiffness, N/m | 5.179254e8 | 5.189461e8 | 0.2 %: ROSS follows ε as the gears are pushed apart |
| contact ratio | 1.552509 | 1.556838 | 0.28 %: as above; here the centres are where they are drawn |
| transmission error, m | 7.152756e-5 | 5.668e-5 | 21 %: ROSS adds to the gap what separation opens, 1.4979e-5 m … |
| … less the gap, m | 6.5488e-6 | 6.685e-6 | 2.1 %: 1.4 % in ROSS's last three turns |

ROSS's compression counts the radial way apart of the gears already: on the loaded flank the exact involute loses it
once, ROSS twice, and its bearings carry the radial force twice. Over the last three turns (benchmarks/against_ross.py)
its force has 1064.88 N at the torque's frequency and 251.29 N at that of the teeth: ours to 0.3 %.
"""

import numpy as np
import pytest
import scipy.optimize
import scipy.special
from gear_pair import HALF_GAP, NATURAL, STIFFNESS, gear_pair
from published_parts import add_spring, assembler_of

from tbm_dynamics import Simulator
from tbm_dynamics.mesh.geometry import ExternalPair
from tbm_dynamics.mesh.waves import Waves
from tbm_dynamics.structure.couplings import Couplings
from tbm_dynamics.structure.system import Drives, System
from tbm_msgs_py.base.operating_point import OperatingPoint

methods = pytest.mark.parametrize("method", ["reduced", "full"])

VARIATION = 0.1  # ε
LOST_CONTACT = {1.5: 0.91898, 2.0: 0.82102, 3.0: 0.66291, 5.0: 0.47092}  # a, ω/ω_n


def released(system, offset, steps, step, method):
    """Compression of the mesh (steps,) m, let go from the equilibrium under an offset of the load."""
    start = system.under(system.operating_point, np.array([0.0, 0.0, 0.0, offset, 0.0, 0.0]))
    return Simulator(start, (2,), step, method).step(np.zeros((steps, 6))).displacement[:, 0, 3]


@methods
@pytest.mark.parametrize(("amplitude", "ratio"), LOST_CONTACT.items())
def test_lost_contact_swings_at_the_exact_frequency(method, amplitude, ratio):
    mean = 0.1
    force = mean * STIFFNESS * HALF_GAP
    x = released(gear_pair(0.0, mean), amplitude * force, 2000, 1e-4, method) / HALF_GAP - 1.0 - mean
    before = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    crossings = before + x[before] / (x[before] - x[before + 1])
    assert len(crossings) > 8
    period = (crossings[-1] - crossings[0]) / (len(crossings) - 1) * 1e-4
    assert 2.0 * np.pi / period / NATURAL == pytest.approx(ratio, rel=6e-5)


def parametric(damping_ratio, variation, speed, cycles, method, parts=50):
    """A small motion about the closed flank over its start, (cycles · parts + 1,), `parts` steps a cycle of teeth."""
    system, step = gear_pair(damping_ratio, 10.0, variation, speed), 2.0 * np.pi / speed / parts
    offset, count = 1e-3 * STIFFNESS * HALF_GAP, cycles * parts + 1
    pushed, alone = (released(system, size, count, step, method) for size in (offset, 0.0))
    motion = pushed - alone
    return motion / motion[0]


@methods
@pytest.mark.parametrize("end", [scipy.special.mathieu_a, scipy.special.mathieu_b])
def test_undamped_instability_ends_where_mathieu_says(method, end):
    # With 2τ = Ωt: y'' + (A − 2q cos 2τ) y = 0, A = (2ω₀/Ω)², q = −ε A/2; turned by half a cycle, q > 0.
    square = scipy.optimize.brentq(lambda A: A - end(1, 0.2 * A / 2.0), 0.5, 2.0)
    motion = parametric(0.0, 0.2, 2.0 * NATURAL / np.sqrt(square), 1, method, parts=100)
    assert motion[-1] == pytest.approx(-1.0, abs=1e-6)


@methods
def test_growth_and_decay_either_side_of_the_instability(method):
    def rate(ratio, aside):
        """Growth per ω₀t: from cycle to cycle of the teeth a motion is y_n+1 = trace y_n − det y_n−1 (Floquet)."""
        turn = 2.0 * np.pi / (2.0 + aside)
        y = parametric(ratio, VARIATION, (2.0 + aside) * NATURAL, 6, method)[::50]
        (trace, det), *_ = np.linalg.lstsq(np.column_stack([y[1:-1], -y[:-2]]), y[2:])
        assert det == pytest.approx(np.exp(-2.0 * ratio * turn), rel=1e-4)  # Liouville
        return np.log(np.abs(np.roots([1.0, -trace, det])).max()) / turn

    ratio, too_much = 0.01, 0.03  # of 4ζ < ε, and of 4ζ > ε
    width = np.sqrt(VARIATION**2 / 4.0 - 4.0 * ratio**2)
    for damping in (ratio, too_much):
        assert rate(damping, 0.0) == pytest.approx(VARIATION / 4.0 - damping, rel=1e-3)
    for side in (-1.0, 1.0):
        assert rate(ratio, 0.95 * side * width) > 0.0 > rate(ratio, 1.05 * side * width)


TURN, RECTANGLE, HARMONICS = 0.06, 0.275, 100
PAIR = ExternalPair(20, 20, 0.01, np.radians(20.0))


def pair_on_bearings():
    """Gears 1 and 2 with their mesh on bearings; a soft spring holds their free turn. The compression's row, (12,)."""
    parts = assembler_of({1: (0.0, 0.0, 0.0), 2: (0.0, PAIR.centre_distance, 0.0)})
    bore = 0.2**2 - 4.0 * 6.57 / (np.pi * 0.03 * 7850.0)
    inertia = 6.57 / 8.0 * (0.2**2 + bore)
    for node in (1, 2):
        parts.add_body(node, 6.57, (inertia, 1.0, 1.0))
        add_spring(parts, node, None, (1e8, 1e8, 1e8, 0.01, 1e8, 1e8))
        translations = parts.dofs(node)[:3]
        parts.C[translations, translations] = 512.64
    mean = PAIR.contact_ratio * 200e9 * 0.03 / 18.0
    damping = 2.0 * 0.07 * np.sqrt(mean * inertia / (2.0 * PAIR.pinion_base_radius**2))
    rows, idle, gearbox = np.zeros((2, 12)), 1e8, 10  # a gearbox of nothing to do
    rows[0], rows[1, gearbox] = parts.mesh_row(1, 2, PAIR, np.pi), 1.0
    numbers, two_pairs = np.arange(1, HARMONICS + 1), PAIR.contact_ratio - 1.0
    variation = np.zeros((2 * HARMONICS, 1))
    rectangle = 2.0 / (np.pi * numbers) * np.sin(np.pi * numbers * two_pairs)
    variation[0::2, 0] = 2.0 * RECTANGLE * mean * rectangle
    couplings = Couplings(
        rows=rows,
        stiffness=np.array([mean, idle]),
        damping=np.array([damping, 0.0]),
        half_gap=np.array([5e-5, 0.0]),
        waves=Waves(
            turns=np.array([1.0]),
            harmonics=(HARMONICS,),
            mesh_stiffness=np.array([mean]),
            mesh_variation=variation,
            gearbox_compliance=np.array([1.0 / idle]),
            gearbox_variation=np.zeros((0, 1)),
            error=np.array([[0.0, 0.0], [-2e-5, 0.0]]),
        ),
        ring_teeth=20,
    )
    motors = np.zeros(12)
    motors[parts.dofs(2)[3]] = -1.0  # the pinion drives by turning against x
    return System(
        M=parts.M,
        C=parts.C + rows.T @ (couplings.damping[:, None] * rows),
        K=parts.K + rows.T @ (couplings.stiffness[:, None] * rows),
        nodes=(1, 2),
        couplings=couplings,
        drives=Drives(np.zeros(1), np.arange(6, 12)[None], np.eye(6)[None]),
        load_dofs=np.arange(6),
        motor_pattern=motors,
        mean_load=np.array([0.0, 0.0, 0.0, -300.0, 0.0, 0.0]),
        operating_point=OperatingPoint(speed=2.0 * np.pi / TURN, torque=300.0, thrust=0.0),
    )


@methods
def test_a_pair_with_backlash_as_ross_has_it(method):
    system, parts = pair_on_bearings(), 3000
    # Three turns, the last two kept. Alike gears: the torque's swing on one is worth half as much on both.
    time = np.arange(3 * parts) * TURN / parts
    loads = np.zeros((len(time), 6))
    loads[:, 3] = -300.0 - 200.0 * np.sin(2.0 * np.pi * time / TURN)
    chunk = Simulator(system, (1, 2), TURN / parts, method).step(loads)
    stiffness, error, _ = system.couplings.waves.evaluate(20.0 * time / TURN)
    compression = chunk.displacement.reshape(len(time), 12) @ system.couplings.rows[0] + error[:, 0]
    force, compression, stiffness = chunk.mesh_force[parts:, 0], compression[parts:], stiffness[parts:, 0]
    assert force.min() > 0.0
    assert force.mean() == pytest.approx(3191.996, rel=2e-4)
    assert stiffness.mean() == pytest.approx(5.179254e8, rel=2e-3)
    assert PAIR.contact_ratio == pytest.approx(1.552509, rel=3e-3)
    assert compression.mean() == pytest.approx(7.152756e-5 - 1.4979e-5, rel=3e-3)
    assert compression.mean() - 5e-5 == pytest.approx(6.5488e-6, rel=0.025)
    lines = 2.0 * np.abs(np.fft.rfft(force)) / len(force)
    assert lines[[2, 40]] == pytest.approx([1064.88, 251.29], rel=3e-3)
