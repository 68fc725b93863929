"""Trends over long times: windows summed up by SQLite itself, bin by bin, so that none of them is held here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from tbm_gsa.comparison import DEAD_SHARE
from tbm_gsa.comparison.live import LARGEST
from tbm_gsa.history.queries import Queries, Selection

# By rank: the value at the place that is nearest to a share of the windows of a bin.
_AT: Final = "max(CASE WHEN {place} = 1 + CAST({share} * (many - 1) + 0.5 AS INTEGER) THEN {value} END)"
_COLUMNS: Final = ", ".join(
    [
        *(_AT.format(place="place", share=share, value="ratio") for share in (0.05, 0.5, 0.95)),
        _AT.format(place="level_place", share=0.5, value="field_rms"),
    ]
)
_BIN: Final = "PARTITION BY point, start_ns / ?"
_QUERY: Final = f"""
SELECT point, bin * ?, many, {_COLUMNS} FROM (
    SELECT point, start_ns / ? AS bin, field_rms, field_rms / model_rms AS ratio, count(*) OVER ({_BIN}) AS many,
        row_number() OVER ({_BIN} ORDER BY field_rms / model_rms) AS place,
        row_number() OVER ({_BIN} ORDER BY field_rms) AS level_place
    FROM windows JOIN sources ON windows.source = sources.id
    WHERE ({{condition}}) AND relative_error IS NOT NULL AND model_rms > 0.0
        AND field_rms >= {DEAD_SHARE} * model_rms AND max(field_rms, model_rms) < {LARGEST}
) GROUP BY point, bin ORDER BY bin, point
"""  # noqa: S608
_PLACES: Final = 5  # for the length of a bin


@dataclass(frozen=True, slots=True)
class TrendRow:
    """Windows of one point in a span of time that begins at a multiple of its length.

    Attributes
    ----------
    point : str
    begin_ns : int
    windows : int
        Steady ones, of a sensor that is not dead.
    low, median, high : float
        5 %, median and 95 % of measured over computed RMS.
    level : float
        Median of the measured RMS, m/s².
    """

    point: str
    begin_ns: int
    windows: int
    low: float
    median: float
    high: float
    level: float


def trend_rows(history: Queries, selection: Selection, bin_ns: int) -> list[TrendRow]:
    """Trend of every point in a selection, in the order of time; bins without a window are left out.

    Parameters
    ----------
    history : Queries
    selection : Selection
        Of one axis.
    bin_ns : int
        Length of a bin.
    """
    return [TrendRow(*row) for row in history.ask(_QUERY, selection, [bin_ns] * _PLACES)]
