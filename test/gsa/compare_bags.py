"""Small recordings for the tests of the comparison."""

from functools import cache

import numpy as np
from scipy.signal import lfilter

from tbm_dynamics import load_machine, simulate
from tbm_msgs_py import ACCELERATION
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.drive_state import DriveState
from tbm_msgs_py.base.units import STANDARD_GRAVITY as G

START_NS = 1_700_000_000_000_000_000
RATE = 2000

__all__ = ["RATE", "START_NS", "G", "model_values", "noise", "plc_values", "write_bag", "write_drives"]


def model_values(seed, duration=10.0, machine=None):
    """Accelerations of a machine, by default dz101, at its test points at the model's own rate, 10 kHz."""
    return _own_values(seed, duration) if machine is None else _values(machine, seed, duration)


@cache
def _own_values(seed, duration):
    return _values(load_machine("dz101"), seed, duration)


def _values(machine, seed, duration):
    points = machine.description.test_points
    response = simulate(machine, duration, seed, settling=machine.settling(), outputs=points.values())
    return {point: response.acceleration(node)[:, :3] for point, node in points.items()}


def noise(duration, level=1.0):
    return level * np.random.default_rng(3).standard_normal((round(duration * RATE), 3))


def write_bag(path, points, *, operating=(), rate=RATE, custom_data=None, more=lambda writer: None):
    """Write blocks of half a second, values (n, 3) by point, operating points (s, level), and what else is to be."""
    with BagWriter(path, custom_data=custom_data) as writer:
        for at, level in operating:
            writer.write_operating_point(START_NS + round(at * 1e9), level)
        for point, values in points.items():
            for first in range(0, len(values), rate // 2):
                block = values[first : first + rate // 2]
                stamp = START_NS + first * 1_000_000_000 // rate
                writer.write_block(
                    f"/tbm/field/{point}/block", stamp, ACCELERATION, np.arange(len(block)) / rate, block
                )
        more(writer)
    return path


def plc_values(values, rate, corner):
    """Every drive's values (n, p) at 10 kHz as a PLC gives them: through a filter of first order, sampled."""
    share = 1.0 - np.exp(-2.0 * np.pi * corner / 10_000)
    filtered, _ = lfilter([share], [1.0, share - 1.0], values, axis=0, zi=(1.0 - share) * values[:1])
    return filtered[:: round(10_000 / rate)]


def write_drives(writer, torque, rate, *, speed=None, begin=0.0):
    """Write torques (n, p) and speeds of the drives at a rate, `begin` s after the first sample of the points."""
    speed = np.full_like(torque, np.nan) if speed is None else speed
    for k, (torques, speeds) in enumerate(zip(torque.tolist(), speed.tolist(), strict=True)):
        writer.write_drives(START_NS + round((begin + k / rate) * 1e9), DriveState(tuple(torques), tuple(speeds)))
