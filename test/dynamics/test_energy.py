"""Reciprocity, passivity and conservation: what holds for every linear structure, and for teeth on springs.

Sources: Maxwell and Betti (a force here moves there as a force there moves here), the passivity of a damped structure
(no load of any direction and frequency draws power from it: the Hermitian part of the mobility is not negative), and
the conservation of energy. Tolerances: the first two are exact, held to the rounding of a solution with numbers that
differ by 1e12. Energy at teeth that part and meet without damping: the reference method to 0.05 % over 1000 strikes (no
trend: the borders of contact lie anywhere in a step); the production method, which finds contact to a 32nd of a
step, loses up to 3e-5 of the energy at a change of contact, as a damping ratio of 5e-6 would.
"""

import numpy as np
import pytest
from gear_pair import HALF_GAP, NATURAL, STIFFNESS, gear_pair
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_files import built, plain

from tbm_dynamics import Simulator


@pytest.fixture(scope="module", params=["dz101", "open380", "dz101 by ratio at 100 Hz"])
def system(request):
    name, *reading = request.param.split(" by ratio at ")
    data = plain(name)
    if reading:
        data["damping"] = {"reading": "ratio", "frequency": 100.0}
    return built(data).assemble()


def receptance(system, frequency, dofs):
    """Motion of some unknowns under unit forces at them, (k, k) complex."""
    omega = 2.0 * np.pi * frequency
    forces = np.eye(system.size)[:, dofs]
    return np.linalg.solve(system.K + 1j * omega * system.C - omega**2 * system.M, forces)[dofs]


@settings(max_examples=10)
@given(frequency=st.floats(0.1, 2000.0), seed=st.integers(0, 10**6))
def test_a_force_here_moves_there_as_a_force_there_moves_here(system, frequency, seed):
    dofs = np.random.default_rng(seed).choice(system.size, 12, replace=False)
    actual = receptance(system, frequency, dofs)
    scale = np.sqrt(np.abs(np.outer(actual.diagonal(), actual.diagonal())))
    assert np.all(np.abs(actual - actual.T) < 1e-6 * scale)


@settings(max_examples=10)
@given(frequency=st.floats(0.1, 2000.0), seed=st.integers(0, 10**6))
def test_no_force_draws_power_from_the_machine(system, frequency, seed):
    random = np.random.default_rng(seed)
    # Forces of every direction on every unknown, scaled so that light and heavy parts count alike.
    scale = np.sqrt(system.M.diagonal())
    shape = random.standard_normal((system.size, 8)) + 1j * random.standard_normal((system.size, 8))
    omega = 2.0 * np.pi * frequency
    forces = scale[:, None] * shape
    motion = np.linalg.solve(system.K + 1j * omega * system.C - omega**2 * system.M, forces)
    power = 0.5 * np.real(np.sum(forces.conj() * (1j * omega * motion), axis=0))
    assert np.all(power > 0.0)
    # What goes in is what the dampers take.
    taken = 0.5 * omega**2 * np.real(np.sum(motion.conj() * (system.C @ motion), axis=0))
    assert power == pytest.approx(taken, rel=1e-6)


def test_every_damper_takes_power_and_none_gives(system):
    values = np.linalg.eigvalsh(system.C)
    assert values.min() > -1e-12 * values.max()


@pytest.mark.parametrize("push", [0.08, 0.3, 1.5])
@pytest.mark.parametrize(("method", "loss"), [("full", 0.0), ("reduced", 3e-5)])
def test_teeth_that_part_and_meet_keep_their_energy(method, push, loss):
    # A push of 10 ms, then ten seconds alone: one flank, the gap, or (the strongest) both flanks.
    steps, start = 100_000, 200
    loads = np.zeros((steps, 6))
    loads[:100, 3] = push * np.sin(np.pi * np.arange(100) / 100) ** 2 * STIFFNESS * HALF_GAP
    chunk = Simulator(gear_pair(0.0, 0.1), (2,), 1e-4, method).step(loads)
    x = chunk.displacement[start:, 0, 3] / HALF_GAP
    speed = (x[2:] - x[:-2]) / (2e-4 * NATURAL)
    spring = 0.5 * np.maximum(np.abs(x[1:-1]) - 1.0, 0.0) ** 2
    energy = 0.5 * speed**2 + spring - 0.1 * (x[1:-1] - 1.1) - 0.5 * 0.1**2
    blocks = energy[: len(energy) // 2000 * 2000].reshape(-1, 2000).mean(axis=1)
    changes = np.count_nonzero(np.diff((chunk.mesh_force[start:, 0] == 0.0).astype(int)))
    assert changes > 900
    assert blocks.max() < blocks[0] * (1.0 + 5e-4)
    assert blocks.min() > blocks[0] * (1.0 - 5e-4 - loss * changes)
