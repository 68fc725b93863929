"""Factors between SI units, which everything inside is in, and those of people and messages."""

import math
from typing import Final

STANDARD_GRAVITY: Final = 9.80665
"""g in m/s²."""
R_MIN: Final = 2.0 * math.pi / 60.0
"""r/min in rad/s."""
NANOSECONDS: Final = 1_000_000_000
"""Nanoseconds in a second: stamps are integers of them."""
