"""When a recording changes while the machine is driven alike: rock, machine or sensor have."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Final

import numpy as np

from tbm_gsa.comparison.offline import PointComparison
from tbm_gsa.comparison.results import AxisResult
from tbm_gsa.signals.changes import changes
from tbm_msgs_py.base.arrays import Array

SHORTEST_S: Final = 15.0
"""Of a part, and of every channel of what is explained: six or seven segments; with less the slow axial band scatters
by half."""
INDEPENDENT_S: Final = 3.0
"""After which levels are nearly: weakly damped modes ring, and the power of a band is taken over a second."""
_LEAST_COVERAGE: Final = 0.5  # of a window that counts
_LEAST_SHARE: Final = 0.9  # of the windows of the fullest channel: one that ends early must not hide what comes later


def change_times(points: Mapping[str, PointComparison]) -> tuple[float, ...]:
    """Find the times at which the levels of bands change, s after the first sample: begins of windows.

    Of all compared axes that have most of the windows at the level of operation that was held longest, in the windows
    that all of them have.
    """
    series = [
        _levels(axis, band) for point in points.values() for axis in point.axes.values() for band in axis.field_band_rms
    ]
    most = max(map(len, series), default=0)
    if not most:
        return ()
    series = [one for one in series if len(one) >= _LEAST_SHARE * most]
    common = sorted(set.intersection(*(set(one) for one in series)))
    if len(common) < 2:
        return ()
    values = np.array([[one[start] for one in series] for start in common])
    length = min(b - a for a, b in pairwise(common))
    together = max(1, round(INDEPENDENT_S / length))
    return tuple(common[place] for place in changes(values, max(2, round(SHORTEST_S / length)), together))


def _levels(axis: AxisResult, band: str) -> dict[float, float]:
    """Logarithm of the RMS of a band by the begin of each window; empty of a channel that shows nothing."""
    table = axis.windows
    columns = zip(table.start, table.level, table.coverage, table.field_band_rms[band], strict=True)
    found = {
        start: rms
        for start, level, coverage, rms in columns
        if level == 0 and start is not None and rms is not None and (coverage or 0.0) >= _LEAST_COVERAGE
    }
    values: Array = np.array(list(found.values()))
    return dict(zip(found, np.log(values).tolist(), strict=True)) if found and (values > 0.0).all() else {}
