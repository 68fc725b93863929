"""What the makers of synthetic recordings share: wireless accelerometers, and how a recording is written."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tbm_dynamics import Machine
from tbm_dynamics.streaming.sensors import SensorModel, SensorPacket, SensorParameters
from tbm_msgs_py import blocks, topics
from tbm_msgs_py.bags.metadata import SYNTHETIC
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.operating_point import OperatingPoint

RATE_HZ = 1000
MODEL_RATE_HZ = 10000
# 2026-01-01T00:00:00Z: a date that no field test of the paper has.
EPOCH_NS = 1_767_225_600 * 1_000_000_000
LATENCY_NS = 20_000_000
G = 9.80665

SENSORS = {
    "cutterhead": {"clock_offset": 0.0021, "clock_drift": 12.0, "dropout_probability": 0.01},
    "shield": {"clock_offset": -0.0013, "clock_drift": -7.0, "dropout_probability": 0.005},
    "walkway": {"clock_offset": 0.0006, "clock_drift": 4.0, "dropout_probability": 0.005},
    "girder": {"clock_offset": 0.0034, "clock_drift": -15.0, "dropout_probability": 0.01},
    "gripper": {"clock_offset": -0.0027, "clock_drift": 9.0, "dropout_probability": 0.02},
}
COMMON = {
    "range": 16.0 * G,
    "noise_density": 100e-6 * G,
    "quantisation": 32.0 * G / 2**16,
    "rate_hz": RATE_HZ,
    "anti_alias_hz": 400.0,
    "packet_samples": 100,
}


def packets(point: str, values: np.ndarray, seed: int) -> list[SensorPacket]:
    """Simulate what the sensor of a test point sends of accelerations (n, 3) in m/s² at the model's rate."""
    sensor = SensorModel(SensorParameters(**COMMON, **SENSORS[point]), MODEL_RATE_HZ, seed, point)
    return [*sensor.process(0, values), *sensor.flush()]


def write_recording(folder: Path, machine: Machine, accelerations: Mapping[str, np.ndarray], seed: int) -> None:
    """Write a recording of accelerations (n, 3) by test point, replacing the one that is there but for its notes."""
    sent = [(packet, point) for point, values in accelerations.items() for packet in packets(point, values, seed)]
    fresh = folder.with_name(folder.name + "_new") / folder.name
    point = machine.operating_point
    arrivals = [EPOCH_NS + packet.stamp_ns + round(packet.time[-1] * 1e9) + LATENCY_NS for packet, _ in sent]
    with BagWriter(fresh, compression="zstd", custom_data=SYNTHETIC) as writer:
        writer.write_operating_point(EPOCH_NS, OperatingPoint(point.speed, point.torque, point.thrust))
        for i in np.argsort(arrivals, kind="stable"):
            packet, name = sent[i]
            writer.write_block(
                topics.absolute(topics.field_block(name)),
                EPOCH_NS + packet.stamp_ns,
                blocks.ACCELERATION,
                packet.time,
                packet.values,
                log_ns=arrivals[i],
                frame_id=name,
            )
    folder.mkdir(parents=True, exist_ok=True)
    for file in fresh.iterdir():
        shutil.move(file, folder / file.name)
    shutil.rmtree(fresh.parent)
