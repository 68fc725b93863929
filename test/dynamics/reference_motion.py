"""The nonlinear system written out once more, for a general ODE solver: every unknown, no basis, no fixed step."""

from functools import lru_cache

import numpy as np
import scipy.integrate


def condition(couplings, cycle):
    """Stiffness and error of every coupling at a mesh phase in cycles, each (2p,)."""
    stiffness, error, _ = couplings.waves.evaluate(np.array([cycle]))
    return stiffness[0], error[0]


def start_of(system, chunk):
    """(q, q̇) where a run starts: what its first row shows, moving as the equilibrium does while the teeth turn."""
    couplings, small = system.couplings, 1e-6
    before, after = (system.equilibrium(*condition(couplings, cycle)).displacement for cycle in (-small, small))
    rate = couplings.ring_teeth * system.operating_point.speed / (2.0 * np.pi)
    return np.concatenate([chunk.displacement[0].ravel(), (after - before) * rate / (2.0 * small)])


def reference_motion(system, start, loads, times, speed, torque=None, tolerance=1e-8, solver="Radau"):
    """Displacements (n, unknowns), accelerations and mesh forces (n, p) of a solver of scipy's at `times`.

    `start` is (q, q̇) at time 0, `loads(t)` the six cutterhead loads, `speed(t)` the integral of the head's speed, rad.
    """
    couplings, n, p = system.couplings, system.size, system.couplings.drives
    R, damping = couplings.rows, couplings.damping
    K = system.K - R.T @ (couplings.stiffness[:, None] * R)
    C = system.C - R.T @ (damping[:, None] * R)
    inverse = np.linalg.inv(system.M)
    motors = (system.operating_point.torque if torque is None else torque) * system.motor_pattern
    teeth = couplings.ring_teeth / (2.0 * np.pi)

    @lru_cache(maxsize=8)  # the solver comes back to the stages of a step
    def held(t):
        small = 1e-7
        ahead, behind = (condition(couplings, teeth * speed(t + dt))[1] for dt in (small, -small))
        return *condition(couplings, teeth * speed(t)), (ahead - behind) / (2.0 * small)

    def coupled(t, y):
        """Forces and contact."""
        stiffness, error, rate = held(t)
        deflection, closing = R @ y[:n] + error, R @ y[n:] + rate
        touching = np.abs(deflection) > couplings.half_gap
        squeeze = deflection - np.sign(deflection) * couplings.half_gap
        return np.where(touching, stiffness * squeeze + damping * closing, 0.0), stiffness * touching, touching

    def right(t, y):
        force = motors - K @ y[:n] - C @ y[n:] - R.T @ coupled(t, y)[0]
        force[system.load_dofs] += loads(t)
        return np.concatenate([y[n:], inverse @ force])

    def jacobian(t, y):
        _, stiffness, touching = coupled(t, y)
        low = [K + R.T @ (stiffness[:, None] * R), C + R.T @ ((damping * touching)[:, None] * R)]
        return np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ low[0], -inverse @ low[1]]])

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
