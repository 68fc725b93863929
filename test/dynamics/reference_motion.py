"""The nonlinear system written out once more, for a general ODE solver: every unknown, no basis, no fixed step.

Two entries of the matrices in a hundred are not zero, so they are kept sparse: dense ones take seven times as long
where teeth strike.
"""

from functools import lru_cache

import numpy as np
import scipy.integrate
from scipy.sparse import bmat, csc_array, csr_array
from scipy.sparse.linalg import inv


def condition(couplings, cycles):
    """Stiffness and error of every coupling at mesh phases (n,) in cycles, each (n, 2p)."""
    stiffness, error, _ = couplings.waves.evaluate(np.array(cycles))
    return stiffness, error


def start_of(system):
    """(q, q̇) where a run starts: moving as the equilibrium does while the teeth turn, held back by the dampers.

    The rotors stand still.
    """
    couplings, small = system.couplings, 1e-6
    stiffness, error = condition(couplings, [-small, 0.0, small])
    before, still, after = (system.equilibrium(*held).displacement for held in zip(stiffness, error, strict=True))
    rate = couplings.ring_teeth * system.operating_point.speed / (2.0 * np.pi) / (2.0 * small)
    velocity, slope = (after - before) * rate, (error[2] - error[0]) * rate
    rotors = system.drives.rotors
    turned = np.linalg.solve(system.K, np.eye(system.size)[:, rotors])
    velocity -= turned @ np.linalg.solve(turned[rotors], velocity[rotors])
    drag = system.C @ velocity + couplings.rows.T @ (couplings.damping * slope)
    return np.concatenate([still - np.linalg.solve(system.K, drag), velocity])


def reference_motion(system, start, loads, times, speed, torque=None, tolerance=1e-8, solver="Radau"):
    """Displacements (n, unknowns), accelerations and mesh forces (n, p) of a solver of scipy's at `times`.

    `start` is (q, q̇) at time 0, `loads(t)` the six cutterhead loads, `speed(t)` the integral of the head's speed, rad.
    """
    couplings, n, p = system.couplings, system.size, system.couplings.drives
    damping = couplings.damping
    R, K, C, identity = (csr_array(matrix) for matrix in (couplings.rows, system.K, system.C, np.eye(n)))
    K, C = K - R.T @ (couplings.stiffness[:, None] * R), C - R.T @ (damping[:, None] * R)
    inverse = inv(csc_array(system.M))
    moment = system.rock_damping * system.operating_point.speed
    constant = ((system.operating_point.torque if torque is None else torque) + moment) * system.motor_pattern
    constant[system.load_dofs[3]] -= moment
    if system.cylinders is not None:
        constant[system.load_dofs[0]] -= system.mean_load[0]
        constant -= system.mean_load[0] * system.cylinders
    if system.controlled is not None:  # springs about where they are in the equilibrium
        constant += system.controlled @ system.equilibrium().displacement
    teeth = couplings.ring_teeth / (2.0 * np.pi)

    @lru_cache(maxsize=8)  # the solver comes back to the stages of a step
    def held(t):
        small = 1e-7
        stiffness, error = condition(couplings, [teeth * speed(t + dt) for dt in (-small, 0.0, small)])
        return stiffness[1], error[1], (error[2] - error[0]) / (2.0 * small)

    def coupled(t, y):
        """Forces and contact."""
        stiffness, error, rate = held(t)
        deflection, closing = R @ y[:n] + error, R @ y[n:] + rate
        touching = np.abs(deflection) > couplings.half_gap
        squeeze = deflection - np.sign(deflection) * couplings.half_gap
        return np.where(touching, stiffness * squeeze + damping * closing, 0.0), stiffness * touching, touching

    def right(t, y):
        force = constant - K @ y[:n] - C @ y[n:] - R.T @ coupled(t, y)[0]
        force[system.load_dofs] += loads(t)
        return np.concatenate([y[n:], inverse @ force])

    def jacobian(t, y):
        _, stiffness, touching = coupled(t, y)
        low = [K + R.T @ (stiffness[:, None] * R), C + R.T @ ((damping * touching)[:, None] * R)]
        return bmat([[None, identity], [-inverse @ low[0], -inverse @ low[1]]])

    absolute = np.repeat([tolerance * 1e-3, tolerance], n)  # m and m/s
    solution = scipy.integrate.solve_ivp(
        right,
        (0.0, times[-1]),
        start,
        solver,
        t_eval=times,
        jac=jacobian,
        rtol=tolerance,
        atol=absolute,
        max_step=2e-3,
    )
    assert solution.success
    states = solution.y.T
    accelerations = np.array([right(t, y)[n:] for t, y in zip(times, states, strict=True)])
    forces = np.array([coupled(t, y)[0][:p] for t, y in zip(times, states, strict=True)])
    assert forces.shape == (len(times), p)
    return states[:, :n], accelerations, forces
