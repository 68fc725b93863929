"""The contents of the small recording that the tests of this folder read."""

import numpy as np
from bag_files import write_accel

from tbm_msgs_py import ACCELERATION, OperatingPoint

START_NS = 1_700_000_000_000_000_000
RATE, SAMPLES, BLOCKS = 2000, 100, 40


def signal(first, count):
    time = (first + np.arange(count)) / RATE
    return np.column_stack([np.sin(2 * np.pi * f * time) for f in (10, 20, 30)])


def fill(writer, blocks=range(BLOCKS)):
    """Blocks of the cutterhead, single samples of the shield, one operating point."""
    writer.write_operating_point(START_NS, OperatingPoint(0.586, 3.04e6, 1.2e7))
    for k in blocks:
        stamp = START_NS + k * SAMPLES * 10**9 // RATE
        offsets = np.arange(SAMPLES) / RATE
        topic = "/tbm/field/cutterhead/block"
        writer.write_block(topic, stamp, ACCELERATION, offsets, signal(k * SAMPLES, SAMPLES))
        for i in range(5):
            write_accel(writer, "/tbm/field/shield/accel", stamp + i * 10**7, (1.0, 2.0, 5.0 * k + i))
