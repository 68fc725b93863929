"""How the commands speak: results on stdout, everything else on stderr, JSON as one document."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import typer
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.table import Table

from tbm_msgs_py.base.printing import printable
from tbm_msgs_py.base.results import json_text


class _Printable(Console):
    """Console that shows control characters in texts, which may be of others, and obeys only its own."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does; columns of tables are as wide as what is shown in them."""
        for column in (column for table in objects if isinstance(table, Table) for column in table.columns):
            column._cells = [printable(str(cell), "\n") for cell in column.cells]
        super().print(*objects, **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Segments of what is printed."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(printable(segment.text, "\n"), segment.style)


# Paths are never wrapped: rich would break them at 80 columns when its output is piped.
results = _Printable(soft_wrap=True, emoji=False, markup=False)
notes = _Printable(stderr=True, soft_wrap=True, emoji=False, markup=False)

JSON_OPTION = typer.Option("--json", help="Print exactly one JSON document on stdout.")
SEED_OPTION = typer.Option("--seed", min=0, max=2**31 - 1, help="Seed of everything random.")
LOADS_OPTION = typer.Option("--loads", help="Table 1's spectra, or the forces on the disc cutters.")
SCHEDULE_OPTION = typer.Option(
    "--schedule",
    help="CSV file with the operating point over time: columns time_s, speed_r_min, torque_kn_m, thrust_kn.",
    dir_okay=False,
)
COLUMN_OPTION = typer.Option(
    "--schedule-column", help="A column of that file by another name, such as speed=rpm; can be repeated."
)
WHERE_OPTION = typer.Option(
    "--schedule-where", help="Only its rows with a text in a column, such as cycle=7; can be repeated."
)
MACHINE_OPTION = typer.Option("--machine", help="Name of a shipped machine, or path of a machine file.")
OUTPUTS_OPTION = typer.Option(
    "--outputs",
    help="Names, separated by commas: indicators, or rms_POINT_AXIS, peak_…, kurtosis_…, rms_LOW-HIGH_hz_…; "
    "default: the eight indicators.",
)


def split_names(given: str | None) -> tuple[str, ...]:
    """Names separated by commas."""
    return tuple(name.strip() for name in (given or "").split(",") if name.strip())


def print_json(document: Any) -> None:
    """Write one JSON document to stdout; numbers that are not finite become null."""
    sys.stdout.write(json_text(document, indent=2) + "\n")


@contextmanager
def progress_bar(title: str = "") -> Iterator[Progress]:
    """Progress on stderr, shown only on a terminal; add a task to it, whose description follows the title."""
    columns = (
        TextColumn(f"{title} {{task.description}}".lstrip(), markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
    )
    with Progress(
        *columns,
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=notes,
        transient=True,
        disable=not notes.is_terminal,
    ) as bar:
        yield bar
