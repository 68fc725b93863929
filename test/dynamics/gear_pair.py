"""The gear pair of Kahraman and Singh as a system for the simulator: one equivalent mass on one mesh with backlash."""

import numpy as np

from tbm_dynamics.mesh.waves import Waves
from tbm_dynamics.structure.couplings import Couplings
from tbm_dynamics.structure.system import Drives, System
from tbm_msgs_py.base.operating_point import OperatingPoint

NATURAL = 2.0 * np.pi * 100.0
"""ω_n of the closed mesh, rad/s: a hundred steps of the default size a cycle."""

HALF_GAP = 1e-4
MASS = 2.0
STIFFNESS = MASS * NATURAL**2


def gear_pair(damping_ratio, mean_force, variation=0.0, speed=1.0):
    """Node 1 is the ring, held; node 2 the pinion, driven and loaded in `rx` on a base circle of 1 m.

    The paper's damper acts in the gap too, so it is none of the mesh's. `mean_force` is in the paper's unit, k b. The
    stiffness is k (1 + variation cos(speed t)).
    """
    size, mesh, gearbox = 12, 6 + 3, 6 + 4  # what the gearbox holds has nothing to do with the mesh
    idle = MASS * (20.0 * NATURAL) ** 2
    M, K, C = (np.diag(np.full(size, value)) for value in (MASS, idle, 0.0))
    rows, motors = np.zeros((2, size)), np.zeros(size)
    rows[0, mesh] = rows[1, gearbox] = motors[mesh] = 1.0
    K[mesh, mesh] = STIFFNESS
    C[mesh, mesh] = 2.0 * damping_ratio * MASS * NATURAL
    return System(
        M=M,
        C=C,
        K=K,
        nodes=(1, 2),
        couplings=Couplings(
            rows=rows,
            stiffness=np.array([STIFFNESS, idle]),
            damping=np.zeros(2),
            half_gap=np.array([HALF_GAP, 0.0]),
            waves=Waves(
                turns=np.array([1.0]),
                harmonics=(1,),
                mesh_stiffness=STIFFNESS,
                mesh_variation=np.array([[variation * STIFFNESS], [0.0]]),
                gearbox_compliance=1.0 / idle,
                gearbox_variation=np.zeros((0, 1)),
                error=np.zeros((2, 2)),
            ),
            ring_teeth=1,
        ),
        drives=Drives(np.zeros(1), np.arange(6, 12)[None], np.eye(6)[None]),
        load_dofs=np.arange(6, 12),
        motor_pattern=motors,
        mean_load=np.zeros(6),
        operating_point=OperatingPoint(speed=speed, torque=mean_force * STIFFNESS * HALF_GAP, thrust=0.0),
    )
