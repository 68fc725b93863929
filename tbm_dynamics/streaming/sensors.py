"""Accelerometer model: what a wireless sensor on the machine records of the model's acceleration; slow live copies.

The sensor, in the order of a real one: mounting rotation and gravity, anti-alias filter, sampling, bias and noise,
range, quantisation, packets with a clock of their own, lost packets. The default parameters leave plain decimation.
"""

from dataclasses import dataclass

import numpy as np
import scipy.signal
from numpy.typing import ArrayLike
from pydantic import Field
from scipy.spatial.transform import Rotation

from tbm_dynamics.loads.noise import hashed_generator
from tbm_dynamics.streaming.sensor_effects import SensorEffects
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.causal_filter import CausalFilter
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.units import NANOSECONDS, STANDARD_GRAVITY

GRAVITY = np.array([0.0, 0.0, STANDARD_GRAVITY])  # m/s²; an accelerometer at rest reads its support, upwards
FILTER_ORDER = 8
LIVE_ORDER = 6
LIVE_CORNER = 0.4  # of the low-pass before a live copy, over the rate of the copy


class SensorParameters(SensorEffects):
    """One accelerometer.

    Attributes
    ----------
    rate_hz : int
        Sampling rate; must divide the rate of the model.
    packet_samples : int
        Samples of a packet.
    """

    rate_hz: int = Field(default=5000, gt=0)
    packet_samples: int = Field(default=250, gt=0)


@dataclass(frozen=True, eq=False)
class SensorPacket:
    """Consecutive samples as the sensor sends them.

    Attributes
    ----------
    stamp_ns : int
        Sensor clock at the first sample, ns after the epoch of the stream.
    time : ndarray, shape (n,)
        Sensor clock after the stamp, s.
    values : ndarray, shape (n, 3)
        Acceleration in the sensor axes, m/s².
    """

    stamp_ns: int
    time: Array
    values: Array


class SensorModel:
    """One accelerometer; what it sends does not depend on the chunks it is fed in.

    Parameters
    ----------
    parameters : SensorParameters
        Of the sensor.
    input_rate_hz : int
        Rate of the accelerations it is fed with, Hz.
    seed : int
        Of noise and lost packets.
    stream_id : str
        Name of the sensor, so that two of them do not share their noise.
    """

    def __init__(self, parameters: SensorParameters, input_rate_hz: int, seed: int, stream_id: str) -> None:
        rate = parameters.rate_hz
        if input_rate_hz % rate:
            raise InputError(f"sensor rate_hz: {rate}, allowed: what divides the input rate of {input_rate_hz} Hz")
        if parameters.anti_alias_hz >= input_rate_hz / 2:
            raise InputError(
                f"sensor anti_alias_hz: {parameters.anti_alias_hz:g}, allowed: below {input_rate_hz / 2:g} Hz"
            )
        self.parameters = parameters
        self.lost_packets = 0
        self._seed = seed
        self._name = f"sensor/{stream_id}"
        self._decimation = input_rate_hz // rate
        self._rotation = Rotation.from_euler("xyz", parameters.mounting_rotation, degrees=True).as_matrix()
        self._offset = GRAVITY * parameters.gravity
        corner = parameters.anti_alias_hz
        self._filter = _low_pass(FILTER_ORDER, corner, input_rate_hz) if corner else None
        self._next_step: int | None = None
        self._first = 0  # absolute index of the first pending sample
        self._pending = np.empty((0, 3))

    def process(self, first_step: int, acceleration: ArrayLike) -> list[SensorPacket]:
        """Feed consecutive accelerations and collect the packets that are complete.

        A step that does not follow the last one starts the sensor afresh; what it had gathered comes out first.

        Parameters
        ----------
        first_step : int
            Absolute step of the first row, from the epoch of the stream.
        acceleration : array_like, shape (n, 3)
            In the machine axes, m/s².
        """
        rows = np.asarray(acceleration, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != 3:
            raise InputError(f"acceleration must have shape (n, 3), not {rows.shape}")
        if not np.all(np.isfinite(rows)):
            raise InputError(f"acceleration from step {first_step} holds a value that is not finite")
        packets = self.flush() if first_step != self._next_step else []
        self._next_step = first_step + len(rows)
        samples, first = self._sample(first_step, rows)
        if not len(self._pending):
            self._first = first
        self._pending = np.concatenate([self._pending, samples])
        size = self.parameters.packet_samples
        while len(self._pending) >= (missing := size - self._first % size):
            packets += self._send(missing)
        return packets

    def flush(self) -> list[SensorPacket]:
        """Send what is gathered as a short packet, and forget the state of the filter."""
        if self._filter:
            self._filter.reset()
        return self._send(len(self._pending)) if len(self._pending) else []

    def _sample(self, first_step: int, rows: Array) -> tuple[Array, int]:
        """Sample before the converter: (m, 3) in the sensor axes, and the absolute index of the first."""
        total = rows + self._offset
        # Written out, because a BLAS product may round differently for another number of rows.
        turned = sum(total[:, axis : axis + 1] * self._rotation[axis] for axis in range(3))
        if self._filter:
            turned = self._filter.process(turned)
        skipped = -first_step % self._decimation
        return turned[skipped :: self._decimation], (first_step + skipped) // self._decimation

    def _send(self, count: int) -> list[SensorPacket]:
        """Packet of the first `count` pending samples; an empty list if it gets lost."""
        parameters, first = self.parameters, self._first
        samples, self._pending = self._pending[:count], self._pending[count:]
        self._first += count
        number = first // parameters.packet_samples
        if hashed_generator(self._seed, f"{self._name}/lost", number).random() < parameters.dropout_probability:
            self.lost_packets += 1
            return []
        clock = 1.0 + parameters.clock_drift * 1e-6
        return [
            SensorPacket(
                self._stamp_ns(first), np.arange(count) / parameters.rate_hz * clock, self._convert(samples, first)
            )
        ]

    def _convert(self, samples: Array, first: int) -> Array:
        """Bias, noise, range and converter, for samples (n, 3) of one packet."""
        parameters, size = self.parameters, self.parameters.packet_samples
        values: Array = samples + np.array(parameters.bias)
        if parameters.noise_density:
            packet = hashed_generator(self._seed, f"{self._name}/noise", first // size).standard_normal((size, 3))
            deviation = parameters.noise_density * np.sqrt(parameters.rate_hz / 2.0)
            values += deviation * packet[first % size :][: len(values)]
        if parameters.range:
            values = np.clip(values, -parameters.range, parameters.range)
        if parameters.quantisation:
            values = np.round(values / parameters.quantisation) * parameters.quantisation
        return values

    def _stamp_ns(self, sample: int) -> int:
        """Sensor clock at an absolute sample, ns after the epoch; in integers, so that it stays exact for weeks."""
        true = sample * NANOSECONDS // self.parameters.rate_hz
        drift = round(true * self.parameters.clock_drift * 1e-6)
        return true + drift + round(self.parameters.clock_offset * NANOSECONDS)


class LiveFilter:
    """Slow copy of a fast signal for live display: low-pass and every `stride`-th sample, causal, in any chunks.

    Parameters
    ----------
    rate_hz : float
        Of the input.
    stride : int
        Input samples per output sample.
    """

    def __init__(self, rate_hz: float, stride: int) -> None:
        self._stride = stride
        self._filter = _low_pass(LIVE_ORDER, LIVE_CORNER * rate_hz / stride, rate_hz) if stride > 1 else None

    def process(self, first_step: int, values: Array) -> list[tuple[int, Array]]:
        """Filter consecutive samples (n, c); returns (step, sample (c,)) at every multiple of the stride."""
        if self._filter:
            values = self._filter.process(values)
        first = -first_step % self._stride
        return [(first_step + i, values[i]) for i in range(first, len(values), self._stride)]


def _low_pass(order: int, corner_hz: float, rate_hz: float) -> CausalFilter:
    """Butterworth low-pass."""
    return CausalFilter(scipy.signal.butter(order, corner_hz, fs=rate_hz, output="sos"))
