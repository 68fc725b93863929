"""The model against a recording: conditioning, statistics, and the comparison afterwards and live."""

from tbm_gsa.comparison.alarm import DEAD_SHARE, AlarmRule, UsualRatio, dead_axes
from tbm_gsa.comparison.levels import LiveOperation
from tbm_gsa.comparison.live import WindowedComparison, WindowResult
from tbm_gsa.comparison.rate import StreamCounters
from tbm_gsa.comparison.results import ComparisonResult
from tbm_gsa.signals.settings import Settings

__all__ = [
    "DEAD_SHARE",
    "AlarmRule",
    "ComparisonResult",
    "LiveOperation",
    "Settings",
    "StreamCounters",
    "UsualRatio",
    "WindowResult",
    "WindowedComparison",
    "dead_axes",
]
