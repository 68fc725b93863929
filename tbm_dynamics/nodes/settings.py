"""Settings of the load and the dynamics node."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from tbm_dynamics.loads.stepper import LoadModel
from tbm_dynamics.streaming.schedule import COLUMNS
from tbm_dynamics.streaming.sensor_effects import SensorEffects
from tbm_msgs_py import topics
from tbm_msgs_py.base.fields import FrozenModel
from tbm_msgs_py.nodes.parameters import MachineSettings, Names, live_parameter, parameter

_COLUMNS = " ".join(f"{key}={name}" for key, name in COLUMNS.items())
_MOST = 500_000  # Hz; a small gear rig has teeth that vibrate at 15 kHz
_OWN = "; 0: the machine's; the topic changes it too"


class OperatingSettings(FrozenModel):
    """Operating point of the load node in the units of people; what is zero is the machine's own."""

    speed: float = live_parameter(0.0, f"speed of the cutterhead (r/min){_OWN}", low=0.0, high=1e9)
    torque: float = live_parameter(0.0, f"its mean torque (kN·m){_OWN}", low=0.0, high=1e9)
    thrust: float = live_parameter(0.0, f"mean thrust (kN){_OWN}", low=0.0, high=1e9)


class LoadSettings(MachineSettings):
    """Parameters of `load_node`."""

    loads: LoadModel = parameter("spectral", "the file's spectra, or the forces on the disc cutters")
    schedule: str = parameter("", "CSV file with the operating point over stream time; empty: as the topic says")
    schedule_columns: Names = parameter((), f"its columns, where not {_COLUMNS}")
    schedule_where: Names = parameter((), "only rows with these cells, as column=text")
    seed: int = parameter(0, "seed of the load realisation", low=0, high=2**31 - 1)
    block_rate: float = parameter(topics.LOAD_BLOCK_RATE, "rate of the loads (Hz)", low=1000.0, high=_MOST)
    block_samples: int = parameter(topics.LOAD_BLOCK_SAMPLES, "samples of a block", low=10, high=100000)
    live_rate: float = live_parameter(topics.LIVE_RATE, "rate of loads/wrench (Hz)", low=1.0, high=1000.0)
    operating_point: OperatingSettings = OperatingSettings()
    wait_for_subscribers: int = parameter(
        0, "subscribers of loads/block to wait for, and 0.3 s more, before the first block", low=0, high=16
    )


class SensorSettings(SensorEffects):
    """The sensors of `dynamics_node`."""

    rate: int = parameter(0, "sampling rate of the sensors (Hz), 0 is block_rate", low=0, high=_MOST)


class DynamicsSettings(MachineSettings):
    """Parameters of `dynamics_node`."""

    loads: LoadModel = parameter("spectral", "level of the received loads: its mean is where a run starts")
    seed: int = parameter(0, "seed of the sensor noise", low=0, high=2**31 - 1)
    load_rate: float = parameter(
        topics.LOAD_BLOCK_RATE, "rate of the received loads (Hz), one step each", low=1000.0, high=_MOST
    )
    live_rate: float = live_parameter(topics.LIVE_RATE, "rate of the live topics (Hz)", low=1.0, high=1000.0)
    block_rate: int = parameter(
        int(topics.MODEL_BLOCK_RATE),
        "rate of the acceleration and mesh force blocks (Hz)",
        low=100,
        high=_MOST,
    )
    block_samples: int = parameter(topics.MODEL_BLOCK_SAMPLES, "samples of a block", low=10, high=100000)
    sensor: SensorSettings = SensorSettings()

    @model_validator(mode="after")
    def _check_rates(self) -> Self:
        whole = round(self.load_rate)
        for name, rate in (("block_rate", self.block_rate), ("sensor.rate", self.sensor.rate)):
            if rate and whole % rate:
                raise ValueError(f"parameter {name}: {rate}, allowed: what divides the load_rate of {whole} Hz")
        return self
