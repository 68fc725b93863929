"""The numbers of a sensitivity study as CSV tables: result → texts. S1, ST, S2 are named as SALib does."""

import csv
import io
from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from tbm_gsa.sensitivity.results import IndexTable, OutputResult, StudyResult, SurrogateScores

Row = Iterable[object]
Outputs = Mapping[str, OutputResult]
INTERVALS: Final = ("S1", "S1_low", "S1_high", "ST", "ST_low", "ST_high")


def gsa_tables(result: StudyResult) -> dict[str, str]:
    """Tables of a study.

    Parameters
    ----------
    result : StudyResult

    Returns
    -------
    dict of str to str
        CSV by file name. An index stands beside its interval; a cell is empty where there is none.
    """
    outputs = result.outputs
    tables = {
        "surrogates": (("output", "surrogate", "chosen", *SurrogateScores.model_fields), _scores(outputs)),
        "indices": (("output", "method", "input", *INTERVALS), _indices(outputs)),
        "interactions": (("output", "input", "other", "S2", "low", "high"), _interactions(outputs)),
        "uncertainty": (
            ("output", "input", "order", "mean", "low", "high", "metamodel", "monte_carlo"),
            _uncertainty(outputs),
        ),
        "convergence": (("output", "asked", "samples", "input", *INTERVALS), _convergence(outputs)),
        "morris": (("output", "input", "mean", "mean_absolute", "low", "high", "deviation"), _morris(outputs)),
    }
    return {f"{name}.csv": _csv(heading, rows) for name, (heading, rows) in tables.items()}


def _csv(heading: Row, rows: Iterable[Row]) -> str:
    """One table."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows([heading, *rows])
    return buffer.getvalue()


def _scores(outputs: Outputs) -> Iterator[Row]:
    for name, output in outputs.items():
        for method, scores in output.scores.items():
            yield name, method, int(method == output.surrogate), *(value for _, value in scores)


def _indices(outputs: Outputs) -> Iterator[Row]:
    for name, output in outputs.items():
        tables: dict[str, IndexTable] = {"chosen": output, **output.by_surrogate, "fast": output.fast}
        if output.groups is not None:
            tables["groups"] = output.groups
        for method, table in tables.items():
            yield from ((name, method, *row) for row in _ranges(table))


def _ranges(table: IndexTable) -> Iterator[Row]:
    """Input, S1 with its ends, ST with its ends."""
    for code, first in table.first.items():
        ends, total_ends = (found.get(code, ("", "")) for found in (table.first_interval, table.total_interval))
        yield code, first, *ends, table.total[code], *total_ends


def _interactions(outputs: Outputs) -> Iterator[Row]:
    for name, output in outputs.items():
        yield from ((name, *pair.inputs, pair.index, *pair.interval) for pair in output.second)


def _uncertainty(outputs: Outputs) -> Iterator[Row]:
    for name, output in outputs.items():
        spreads = {"S1": output.paths.first, "ST": output.paths.total} if output.paths else {}
        for order, spread in spreads.items():
            for code, mean in spread.mean.items():
                yield name, code, order, mean, *spread.interval[code], spread.metamodel[code], spread.monte_carlo[code]


def _convergence(outputs: Outputs) -> Iterator[Row]:
    for name, output in outputs.items():
        for step in output.convergence:
            asked = " ".join(map(str, step.asked))
            yield from ((name, asked, step.samples, *row) for row in _ranges(step))


def _morris(outputs: Outputs) -> Iterator[Row]:
    for name, output in outputs.items():
        found = output.morris
        for code, mean in found.mean.items():
            ends = found.mean_absolute_interval[code]
            yield name, code, mean, found.mean_absolute[code], *ends, found.deviation[code]
