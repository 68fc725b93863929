"""The numbers of a sensitivity study as CSV tables: result → texts. S1, ST, S2 are named as SALib does."""

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Final

from tbm_gsa.sensitivity.results import (
    NOT_DETERMINED,
    IndexTable,
    OutputResult,
    SpectrumPart,
    SpectrumResult,
    StudyResult,
    SurrogateScores,
)

Cells = tuple[object, ...]


def gsa_tables(result: StudyResult) -> dict[str, str]:
    """Tables of a study.

    Parameters
    ----------
    result : StudyResult

    Returns
    -------
    dict of str to str
        CSV by file name. An index stands beside its interval; a cell is empty where there is none, and says
        "not determined" where the surrogate does not follow its output. ``spectra.csv`` is there if spectra are.
    """
    tables = {
        f"{table}.csv": _csv(
            [("output", *heading), *((name, *row) for name, output in result.outputs.items() for row in rows(output))]
        )
        for table, (heading, rows) in TABLES.items()
    }
    if result.spectra:
        rows = ((name, *row) for name, spectrum in result.spectra.items() for row in _spectrum(spectrum))
        tables["spectra.csv"] = _csv([SPECTRA, *rows])
    return tables


def _csv(rows: Iterable[Cells]) -> str:
    """One table."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    return buffer.getvalue()


def _scores(output: OutputResult) -> Iterator[Cells]:
    for method, scores in output.scores.items():
        yield method, int(method == output.surrogate), *(value for _, value in scores), int(scores.determined)


def _shown(numbers: Cells, determined: bool) -> Cells:
    """Numbers of a surrogate that follows its output; in place of any other's the words that say so."""
    return numbers if determined else (NOT_DETERMINED,) * len(numbers)


def _indices(output: OutputResult) -> Iterator[Cells]:
    tables: dict[str, IndexTable] = {"chosen": output, **output.by_surrogate}
    if output.fast is not None:
        tables["fast"] = output.fast
    if output.groups is not None:
        tables["groups"] = output.groups
    for method, table in tables.items():
        determined = output.scores.get(method, output).determined
        yield from ((method, code, *_shown(tuple(numbers), determined)) for code, *numbers in _ranges(table))


def _ranges(table: IndexTable) -> Iterator[Cells]:
    """Input, S1 with its ends, ST with its ends."""
    for code, first in table.first.items():
        ends, total_ends = (found.get(code, ("", "")) for found in (table.first_interval, table.total_interval))
        yield code, first, *ends, table.total[code], *total_ends


def _interactions(output: OutputResult) -> Iterator[Cells]:
    for pair in output.second:
        yield *pair.inputs, *_shown((pair.index, *pair.interval), output.determined)


def _uncertainty(output: OutputResult) -> Iterator[Cells]:
    spreads = {"S1": output.paths.first, "ST": output.paths.total} if output.paths else {}
    for order, spread in spreads.items():
        for code, mean in spread.mean.items():
            numbers = (mean, *spread.interval[code], spread.metamodel[code], spread.monte_carlo[code])
            yield code, order, *_shown(numbers, output.scores["krg"].determined)


def _convergence(output: OutputResult) -> Iterator[Cells]:
    for step in output.convergence:
        asked = " ".join(map(str, step.asked))
        for code, *numbers in _ranges(step):
            yield asked, step.samples, code, *_shown(tuple(numbers), output.determined)


def _morris(output: OutputResult) -> Iterator[Cells]:
    found = output.morris
    if found is None:
        return
    for code, mean in found.mean.items():
        numbers = (mean, found.mean_absolute[code], *found.mean_absolute_interval[code], found.deviation[code])
        yield code, *_shown(numbers, output.determined)


def _spectrum(spectrum: SpectrumResult) -> Iterator[Cells]:
    """Rows of the whole, then of components, then of bands."""
    parts: list[tuple[Cells, SpectrumPart]] = [(("whole", "", "", spectrum.held), spectrum)]
    parts += [((f"component {k}", "", "", part.share), part) for k, part in enumerate(spectrum.components, start=1)]
    parts += [(("band", part.low, part.high, ""), part) for part in spectrum.bands]
    for cells, part in parts:
        yield from ((*cells, part.r2_cv, code, *_shown(tuple(rest), part.determined)) for code, *rest in _ranges(part))


_INTERVALS: Final = ("S1", "S1_low", "S1_high", "ST", "ST_low", "ST_high")
SPECTRA: Final = ("spectrum", "part", "low_hz", "high_hz", "share", "r2_cv", "input", *_INTERVALS)
TABLES: Final[Mapping[str, tuple[tuple[str, ...], Callable[[OutputResult], Iterator[Cells]]]]] = {
    "surrogates": (("surrogate", "chosen", *SurrogateScores.model_fields, "determined"), _scores),
    "indices": (("method", "input", *_INTERVALS), _indices),
    "interactions": (("input", "other", "S2", "low", "high"), _interactions),
    "uncertainty": (("input", "order", "mean", "low", "high", "metamodel", "monte_carlo"), _uncertainty),
    "convergence": (("asked", "samples", "input", *_INTERVALS), _convergence),
    "morris": (("input", "mean", "mean_absolute", "low", "high", "deviation"), _morris),
}
