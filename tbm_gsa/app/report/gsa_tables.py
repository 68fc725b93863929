"""The numbers of a sensitivity study as CSV tables: document → texts."""

import csv
import io
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

Row = Iterable[object]
SCORES: Final = (
    "transform",
    "r2_cv",
    "r2_test",
    "rmse_cv",
    "rmse_test",
    "largest_error_cv",
    "largest_error_test",
)
INTERVALS: Final = ("first", "first_low", "first_high", "total", "total_low", "total_high")


def gsa_tables(document: Mapping[str, Any]) -> dict[str, str]:
    """Make the tables of a study.

    Parameters
    ----------
    document : mapping
        See `tbm_gsa.sensitivity.study.document.study_document`.

    Returns
    -------
    dict of str to str
        CSV by file name. An index stands beside its interval; a cell is empty where there is none.
    """
    outputs = document["outputs"]
    return {
        "surrogates.csv": _csv(("output", "surrogate", "chosen", *SCORES), _scores(outputs)),
        "indices.csv": _csv(("output", "method", "input", *INTERVALS), _indices(outputs)),
        "interactions.csv": _csv(("output", "input", "other", "second", "low", "high"), _interactions(outputs)),
        "uncertainty.csv": _csv(
            ("output", "input", "order", "mean", "low", "high", "metamodel", "monte_carlo"), _uncertainty(outputs)
        ),
        "convergence.csv": _csv(("output", "asked", "samples", "input", *INTERVALS), _convergence(outputs)),
        "morris.csv": _csv(("output", "input", "mean", "mean_absolute", "low", "high", "deviation"), _morris(outputs)),
    }


def _csv(heading: Row, rows: Iterable[Row]) -> str:
    """Write one table."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows([heading, *rows])
    return buffer.getvalue()


def _scores(outputs: Mapping[str, Any]) -> Iterator[Row]:
    for name, output in outputs.items():
        for method, scores in output["scores"].items():
            yield name, method, int(method == output["surrogate"]), *(scores[key] for key in SCORES)


def _indices(outputs: Mapping[str, Any]) -> Iterator[Row]:
    for name, output in outputs.items():
        blocks = {"chosen": output, **output["by_surrogate"], "fast": output["fast"], "groups": output["groups"]}
        for method, block in blocks.items():
            yield from ((name, method, *row) for row in _ranges(block))


def _ranges(block: Mapping[str, Any]) -> Iterator[Row]:
    """Input, first index with ends, total index with ends."""
    for code in block.get("first", {}):
        ends = {key: block[f"{key}_interval"].get(code, ("", "")) for key in ("first", "total")}
        yield code, block["first"][code], *ends["first"], block["total"][code], *ends["total"]


def _interactions(outputs: Mapping[str, Any]) -> Iterator[Row]:
    for name, output in outputs.items():
        for pair in output["second"]:
            yield name, *pair["inputs"], pair["index"], *pair["interval"]


def _uncertainty(outputs: Mapping[str, Any]) -> Iterator[Row]:
    for name, output in outputs.items():
        for order in ("first", "total") if output["paths"] else ():
            spread = output["paths"][order]
            for code, mean in spread["mean"].items():
                parts = (spread["metamodel"][code], spread["monte_carlo"][code])
                yield name, code, order, mean, *spread["interval"][code], *parts


def _convergence(outputs: Mapping[str, Any]) -> Iterator[Row]:
    for name, output in outputs.items():
        for step in output["convergence"]:
            asked = " ".join(str(number) for number in step["asked"])
            yield from ((name, asked, step["samples"], *row) for row in _ranges(step))


def _morris(outputs: Mapping[str, Any]) -> Iterator[Row]:
    for name, output in outputs.items():
        found = output["morris"]
        for code, mean in found["mean"].items():
            ends = found["mean_absolute_interval"][code]
            yield name, code, mean, found["mean_absolute"][code], *ends, found["deviation"][code]
