"""The nonlinear system written out once more, for a general ODE solver: every unknown, no basis, no fixed step."""

import numpy as np
import scipy.integrate


def condition(meshes, cycle):
    """Stiffness and error of every mesh at a mesh phase in cycles, each (p,)."""
    table = np.append(meshes.stiffness_table, meshes.stiffness_table[0])
    stiffness = np.interp((cycle - meshes.phases) % 1.0, np.linspace(0.0, 1.0, len(table)), table)
    tooth = meshes.tooth_error * np.sin(2.0 * np.pi * (cycle - meshes.phases))
    turn = cycle / meshes.pinion_teeth + meshes.shaft_phases
    return stiffness, tooth + meshes.shaft_error * np.sin(2.0 * np.pi * turn)


def start_of(system, chunk):
    """(q, q̇) where a run starts: what its first row shows, moving as the equilibrium does while the teeth turn."""
    meshes, small = system.meshes, 1e-6
    before, after = (system.equilibrium(*condition(meshes, cycle)).displacement for cycle in (-small, small))
    rate = meshes.ring_teeth * system.operating_point.speed / (2.0 * np.pi)
    return np.concatenate([chunk.displacement[0].ravel(), (after - before) * rate / (2.0 * small)])


def reference_motion(system, start, loads, times, speed, torque=None, tolerance=1e-8):
    """Displacements (n, unknowns), accelerations and mesh forces (n, p) of scipy's Radau at `times`.

    `start` is (q, q̇) at time 0, `loads(t)` the six cutterhead loads, `speed(t)` the integral of the head's speed, rad.
    """
    meshes, n, p = system.meshes, system.size, system.meshes.count
    R = meshes.rows
    K = system.K - meshes.mean_stiffness * R.T @ R
    C = system.C - meshes.damping * R.T @ R
    inverse = np.linalg.inv(system.M)
    motors = (system.operating_point.torque if torque is None else torque) * system.motor_pattern
    teeth = meshes.ring_teeth / (2.0 * np.pi)

    def held(t):
        small = 1e-7
        rate = (condition(meshes, teeth * speed(t + small))[1] - condition(meshes, teeth * speed(t - small))[1]) / (
            2.0 * small
        )
        return *condition(meshes, teeth * speed(t)), rate

    def mesh(t, y):
        """Forces and contact."""
        stiffness, error, rate = held(t)
        deflection, closing = R @ y[:n] + error, R @ y[n:] + rate
        touching = np.abs(deflection) > meshes.half_gap
        squeeze = deflection - np.sign(deflection) * meshes.half_gap
        return np.where(touching, stiffness * squeeze + meshes.damping * closing, 0.0), stiffness * touching, touching

    def right(t, y):
        force = motors - K @ y[:n] - C @ y[n:] - R.T @ mesh(t, y)[0]
        force[system.load_dofs] += loads(t)
        return np.concatenate([y[n:], inverse @ force])

    def jacobian(t, y):
        _, stiffness, touching = mesh(t, y)
        low = [K + R.T @ (stiffness[:, None] * R), C + meshes.damping * R.T @ (touching[:, None] * R)]
        return np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ low[0], -inverse @ low[1]]])

    absolute = np.repeat([tolerance * 1e-3, tolerance], n)  # m and m/s
    solution = scipy.integrate.solve_ivp(
        right,
        (0.0, times[-1]),
        start,
        "Radau",
        t_eval=times,
        jac=jacobian,
        rtol=tolerance,
        atol=absolute,
        max_step=2e-3,
    )
    assert solution.success
    states = solution.y.T
    accelerations = np.array([right(t, y)[n:] for t, y in zip(times, states, strict=True)])
    forces = np.array([mesh(t, y)[0] for t, y in zip(times, states, strict=True)])
    assert forces.shape == (len(times), p)
    return states[:, :n], accelerations, forces
