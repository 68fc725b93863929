"""The simple alarm on the level, with the reason why it was raised."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tbm_gsa.comparison import AlarmRule, UsualRatio, WindowResult

_AXES = ("x", "y", "z")


class ErrorAlarm:
    """Watches the windows of all test points.

    Parameters
    ----------
    threshold : float
        Share by which measured and computed RMS differ, or by which their ratio changes against the baseline.
    windows : int
        Consecutive windows over it.
    axes : sequence of str
        That are watched.
    baseline : str
        Name; empty: none.
    usual : mapping of str to UsualRatio
        What is usual by the baseline, by test point.
    """

    def __init__(
        self, threshold: float, windows: int, axes: Sequence[str], baseline: str, usual: Mapping[str, UsualRatio]
    ) -> None:
        self._rule = AlarmRule(threshold, windows, usual, [_AXES.index(axis) for axis in axes])
        what = (
            f"measured over computed level changed against {baseline}" if baseline else "measured and computed differ"
        )
        self._text = f"{what} by more than {threshold:g} for {windows} windows"

    @property
    def raised(self) -> frozenset[str]:
        """Test points whose alarm stands."""
        return self._rule.raised

    def update(self, result: WindowResult) -> str:
        """Add a window of a test point; why the alarm is raised by it, empty if it is not."""
        return self.reason(result.point) if self._rule.update(result) else ""

    def reason(self, point: str) -> str:
        """Why the alarm of a test point is raised."""
        return f"{point}: {self._text}"
