"""What an accelerometer does to the signal: the parameters of the sensor model, without the model."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import ConfigDict, Field, model_validator

from tbm_msgs_py.base.fields import FrozenModel

_Bias = Annotated[float, Field(ge=-1e4, le=1e4)]
_Angle = Annotated[float, Field(ge=-360.0, le=360.0)]


class SensorEffects(FrozenModel):
    """Effects of one accelerometer on the signal; zero switches one off.

    The fields describe themselves: they are parameters of the dynamics node, too. The delay of the anti-alias filter, a
    Butterworth low-pass before sampling, stays in the signal, as in a sensor; clock errors show in the stamps only; the
    rotation is about the machine axes in this order.
    """

    model_config = ConfigDict(allow_inf_nan=False)

    range: float = Field(0.0, ge=0.0, description="full scale (m/s²), 0 is unlimited")
    noise_density: float = Field(0.0, ge=0.0, description="noise, one-sided (m/s²/√Hz)")
    quantisation: float = Field(0.0, ge=0.0, description="step of the converter (m/s²)")
    bias: tuple[_Bias, _Bias, _Bias] = Field((0.0, 0.0, 0.0), description="bias of the sensor axes (m/s²)")
    anti_alias_hz: float = Field(0.0, ge=0.0, description="corner of the anti-alias filter (Hz), 0 is none")
    clock_offset: float = Field(0.0, ge=-3600.0, le=3600.0, description="sensor clock minus true time (s)")
    clock_drift: float = Field(0.0, ge=-99999.0, le=99999.0, description="how much the sensor clock runs fast (ppm)")
    dropout_probability: float = Field(0.0, ge=0.0, le=1.0, description="share of blocks lost")
    mounting_rotation: tuple[_Angle, _Angle, _Angle] = Field(
        (0.0, 0.0, 0.0), description="roll, pitch, yaw of the sensors in the machine axes (degrees)"
    )
    gravity: bool = Field(False, description="whether the sensors read gravity too")

    @model_validator(mode="after")
    def _check_step(self) -> Self:
        if self.range and self.quantisation > self.range:
            raise ValueError(f"quantisation {self.quantisation:g} m/s² must not exceed the range {self.range:g} m/s²")
        return self
