"""Statistics of a run's accelerations, as a comparison with a recording takes them."""

from collections.abc import Mapping, Sequence

import numpy as np

from tbm_dynamics.machine.sensor_place import SensorPlace
from tbm_dynamics.response import Response
from tbm_gsa.sensitivity.study.outputs import Vibration
from tbm_gsa.signals.clock import sampling_rate
from tbm_gsa.signals.conditioning import Band, Frame, common_band, compared_axes
from tbm_gsa.signals.estimates import SignalStatistics, estimate
from tbm_gsa.signals.reduction import SignalReducer
from tbm_gsa.signals.settings import Settings, band_name


def vibration_statistics(
    response: Response, wanted: Sequence[Vibration], points: Mapping[str, int | SensorPlace], high_hz: float | None
) -> dict[str, float]:
    """Statistics by name, in m/s² (kurtosis: 1).

    Parameters
    ----------
    response : Response
        With the nodes of the test points.
    wanted : sequence of Vibration
    points : mapping of str to int or SensorPlace
        Test points of the machine.
    high_hz : float or None
        Upper limit of the band; by default that of a comparison with a recording of a high rate.

    Returns
    -------
    dict of str to float
    """
    bands = tuple(dict.fromkeys(output.band for output in wanted if output.band is not None))
    settings = Settings(high_hz=high_hz, bands=bands)
    sides = dict.fromkeys((output.point, _frame(output.axis)) for output in wanted)
    found = {(point, frame): _statistics(response, points[point], frame, settings) for point, frame in sides}
    return {
        output.name: found[output.point, _frame(output.axis)][output.axis].values[
            output.statistic if output.band is None else band_name(*output.band)
        ]
        for output in wanted
    }


def _frame(axis: str) -> Frame:
    return "fixed" if axis in compared_axes("fixed") else "rotating"


def _statistics(
    response: Response, point: int | SensorPlace, frame: Frame, settings: Settings
) -> dict[str, SignalStatistics]:
    rate = sampling_rate(response.time)
    band = common_band(rate)
    if settings.high_hz is not None:
        band = Band(band.low, settings.high_hz)
    reducer = SignalReducer(rate, band, frame, settings)
    reducer.feed(response.time, np.ascontiguousarray(response.acceleration(point)[:, :3]))
    signal = reducer.finish()
    return estimate(signal, {0: 1.0}, settings)
