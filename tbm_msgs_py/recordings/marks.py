"""Marks by which a driver says that a message holds no measurement (`sensor_msgs/Imu`, REP 145)."""

from typing import Final

UNMEASURED: Final = -1.0
"""Element 0 of the covariance of what is not measured."""
UNMEASURED_TEXT: Final = (
    "linear_acceleration_covariance[0] is -1, the driver's word for not measured, allowed: measured samples"
)
