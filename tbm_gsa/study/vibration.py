"""Statistics of a run's accelerations, conditioned as a comparison with a recording does it."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Final

import numpy as np

from tbm_dynamics.response import Response
from tbm_gsa.arrays import Array
from tbm_gsa.comparison.conditioning import Band, Conditioned, common_band, compared_axes, condition, sampling_rate
from tbm_gsa.comparison.statistics import band_rms, kurtosis, peak, rms
from tbm_gsa.study.outputs import Vibration

COLUMNS: Final = {**compared_axes("fixed"), **compared_axes("rotating")}
_STATISTICS: Final[Mapping[str, Callable[[Array], Array]]] = {"rms": rms, "peak": peak, "kurtosis": kurtosis}


def vibration_statistics(
    response: Response, wanted: Sequence[Vibration], nodes: Mapping[str, int], high_hz: float | None
) -> dict[str, float]:
    """Statistics by name, in m/s² (kurtosis: 1).

    Parameters
    ----------
    response : Response
        With the nodes of the test points.
    wanted : sequence of Vibration
    nodes : mapping of str to int
        Test points of the machine.
    high_hz : float or None
        Upper limit of the band; by default that of a comparison with a recording of a high rate.

    Returns
    -------
    dict of str to float
    """
    rate = sampling_rate(response.time)
    band = common_band(rate)
    if high_hz is not None:
        band = Band(band.low, high_hz)

    @cache
    def conditioned(point: str) -> Conditioned:
        return condition(response.time, response.acceleration(nodes[point])[:, :3], rate, band)

    return {output.name: _statistic(output, conditioned(output.point)) for output in wanted}


def _statistic(output: Vibration, signal: Conditioned) -> float:
    columns = signal.values[:, COLUMNS[output.axis]]
    if output.band is not None:
        return float(np.linalg.norm(band_rms([columns], signal.rate_hz, *output.band)))
    return float(_STATISTICS[output.statistic](columns[:, 0] if columns.shape[1] == 1 else np.hypot(*columns.T)))
