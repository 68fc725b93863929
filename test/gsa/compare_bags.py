"""Small recordings for the tests of the comparison."""

from functools import cache

import numpy as np

from tbm_dynamics import load_machine, simulate
from tbm_msgs_py import ACCELERATION
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.units import STANDARD_GRAVITY as G

START_NS = 1_700_000_000_000_000_000
RATE = 2000

__all__ = ["RATE", "START_NS", "G", "model_values", "noise", "write_bag"]


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


def write_bag(path, points, *, operating=(), rate=RATE, custom_data=None):
    """Write blocks of half a second, values (n, 3) by point, and operating points (s, level)."""
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
    return path
