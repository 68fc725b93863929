"""Factors between SI units, which everything inside is in, and those of people and messages."""

import math
from datetime import UTC, datetime
from typing import Final

STANDARD_GRAVITY: Final = 9.80665
"""g in m/s²."""
R_MIN: Final = 2.0 * math.pi / 60.0
"""r/min in rad/s."""
NANOSECONDS: Final = 1_000_000_000
"""Nanoseconds in a second: stamps are integers of them."""


def iso_time(stamp_ns: int) -> str:
    """ISO 8601 in UTC, to the millisecond."""
    moment = datetime.fromtimestamp(stamp_ns // 1_000_000 / 1000.0, UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")
