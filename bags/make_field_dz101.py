"""Make `bags/field_dz101`, a synthetic recording of five accelerometers: `python bags/make_field_dz101.py`.

No measured record of this machine is public. This one is a simulation of a deliberately different machine (other
stiffness, damping and load realisation) through a model of wireless accelerometers: anti-alias filter, noise, range,
quantisation, clocks that are off and drift, lost packets. Each test point is scaled so that the axial RMS in the
compared band is Table 2's measured value; the paper gives none for walkway and girder, they take the factors of their
neighbours.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from tbm_dynamics import Machine, load_machine, simulate
from tbm_dynamics.streaming.sensors import SensorModel, SensorPacket, SensorParameters
from tbm_gsa.signals.conditioning import ZeroPhaseConditioner, common_band
from tbm_msgs_py import blocks, topics
from tbm_msgs_py.bags.metadata import SYNTHETIC
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.base.operating_point import OperatingPoint

FOLDER = Path(__file__).parent / "field_dz101"
DURATION_S = 30.0
RATE_HZ = 1000
MODEL_RATE_HZ = 10000
SEED = 2015
# 2026-01-01T00:00:00Z: a date that no field test of the paper has.
EPOCH_NS = 1_767_225_600 * 1_000_000_000
LATENCY_NS = 20_000_000
G = 9.80665

DIFFERENT = {
    "x4": 2e-3,
    "x10": 0.08,
    "x11": 6e-4,
    "x16": 0.6,
    "x18": 0.7,
    "x20": 1.6,
    "x22": 0.75,
    "x23": 1.4,
    "x25": 1.5,
}
MEASURED_G = {"cutterhead": 0.93, "shield": 0.40, "gripper": 0.08}
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


def accelerations(machine: Machine) -> dict[str, np.ndarray]:
    """Accelerations of the different machine at its test points, each (n, 3) m/s², scaled to Table 2."""
    points = machine.description.test_points
    response = simulate(machine.with_inputs(**DIFFERENT), DURATION_S, SEED, outputs=points.values())
    motion = {point: response.acceleration(node)[:, :3] for point, node in points.items()}
    band = common_band(RATE_HZ, MODEL_RATE_HZ)
    factor = {}
    for point, measured in MEASURED_G.items():
        conditioner = ZeroPhaseConditioner(MODEL_RATE_HZ, band, block=np.inf)
        segments = [*conditioner.feed(response.time, motion[point]), *conditioner.finish()]
        axial = np.concatenate([segment.acceleration[:, 0] for segment in segments])
        factor[point] = measured * G / np.sqrt(np.mean(axial**2))
    factor["walkway"] = factor["shield"]
    factor["girder"] = np.sqrt(factor["shield"] * factor["gripper"])
    return {point: factor[point] * values for point, values in motion.items()}


def packets(point: str, values: np.ndarray) -> list[SensorPacket]:
    """Simulate what the sensor of a test point sends."""
    sensor = SensorModel(SensorParameters(**COMMON, **SENSORS[point]), MODEL_RATE_HZ, SEED, point)
    return [*sensor.process(0, values), *sensor.flush()]


def main() -> None:
    """Write the recording, replacing the one that is there but for its notes."""
    machine = load_machine("dz101")
    sent = [(packet, point) for point, values in accelerations(machine).items() for packet in packets(point, values)]
    fresh = FOLDER.with_name(FOLDER.name + "_new") / FOLDER.name
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
    FOLDER.mkdir(exist_ok=True)
    for file in fresh.iterdir():
        shutil.move(file, FOLDER / file.name)
    shutil.rmtree(fresh.parent)


if __name__ == "__main__":
    main()
