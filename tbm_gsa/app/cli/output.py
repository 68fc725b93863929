"""Output of the commands: results on stdout, everything else on stderr, JSON as one document."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as ProgressBar
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.files import json_text
from tbm_msgs_py.base.progress import Progress
from tbm_msgs_py.base.texts import printable

if TYPE_CHECKING:
    from pydantic import BaseModel


@contextmanager
def _named(stream: IO[str]) -> Iterator[None]:
    """Add the name of the stream to its errors, but for a reader that has gone."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OSError(error.errno, error.strerror, getattr(stream, "name", "a stream")) from None


class _Printable(Console):
    """Console that shows control characters in texts, which may be of others, and obeys only its own."""

    def print(self, *objects: Any, **options: Any) -> None:  # as rich has it
        """Print as rich does; columns of tables are as wide as what is shown in them."""
        for column in (column for table in objects if isinstance(table, Table) for column in table.columns):
            column._cells = [printable(str(cell), "\n") for cell in column.cells]
        with _named(self.file):
            super().print(*objects, **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Segments of what is printed."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(printable(segment.text, "\n"), segment.style)


# Paths are never wrapped: rich would break them at 80 columns when its output is piped.
results = _Printable(soft_wrap=True, emoji=False, markup=False)
results.width = max(80, results.width)  # on fewer columns rich would cut off figures of tables
notes = _Printable(stderr=True, soft_wrap=True, emoji=False, markup=False)

JSON_OPTION = typer.Option("--json", help="Print exactly one JSON document on stdout.")
SEED_OPTION = typer.Option("--seed", min=0, max=2**31 - 1, help="Seed of everything random.")
LOADS_OPTION = typer.Option("--loads", help="The file's spectra, or the forces on the disc cutters.")
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
TimeStep = Annotated[
    float | None,
    typer.Option("--time-step", min=1e-7, max=1e-4, help="Time step (s); default: the machine's, see machine show."),
]
MACHINE_HELP = "Name of `machine list`, or path of a machine file"
MachineOption = Annotated[str, typer.Option("--machine", metavar="<name|file>", help=f"{MACHINE_HELP}.")]
DEFAULT_MACHINE = "dz101"
LONGEST_S = 1e9
"""Of a time that an option may state, s: thirty years."""
LARGEST_MB = 1e9
"""Of an amount that an option may state, MB."""
OUTPUTS_HELP = (
    "Names, separated by commas: indicators, or rms_POINT_AXIS, peak_…, kurtosis_…, rms_LOW-HIGH_hz_…, spectrum_…; "
    "default: "
)
OUTPUTS_OPTION = typer.Option("--outputs", help=f"{OUTPUTS_HELP}the eight indicators.")


def named(context: typer.Context, parameter: str) -> bool:
    """Whether a parameter stands on the command line, be it with its default value."""
    return getattr(context.get_parameter_source(parameter), "name", "") == "COMMANDLINE"


def split_names(option: str, given: Iterable[str]) -> tuple[str, ...]:
    """Names of an option that may be repeated or hold several, separated by commas; none is bad input."""
    texts = list(given)
    names = tuple(name.strip() for text in texts for name in text.split(","))
    if not all(names):
        raise InputError(f"{option} {','.join(texts)!r}: allowed: names, separated by commas")
    return names


def narrow_table(title: str, *headings: str) -> Table:
    """Table for 80 characters.

    A heading that starts with ``>`` is that of right-aligned figures, one with ``=`` that of names of ours: both stay
    in one line. Other texts take several lines where there is no room.
    """
    table = Table(title=Text(title) if title else None, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.show_edge = table.pad_edge = False
    for heading in headings:
        side: Literal["left", "right"] = "right" if heading.startswith(">") else "left"
        name = Text(heading.removeprefix(">").removeprefix("="))
        table.add_column(name, justify=side, overflow="fold", no_wrap=heading[:1] in (">", "="))
    return table


def add_row(table: Table, *cells: object) -> None:
    """Add a row; names from files of others are no markup."""
    table.add_row(*(Text(str(cell)) for cell in cells))


def ranked_inputs(ranked: Iterable[tuple[str, float]]) -> str:
    """Write inputs with their shares so that a cell of several lines breaks between two of them only."""
    return " ".join(f"{code}:{share:.2f}" for code, share in ranked)


def print_sentence(text: str) -> None:
    """Print a sentence without paths, which may take several lines."""
    results.print(Text(text), soft_wrap=False)


def print_json(document: BaseModel) -> None:
    """Write one JSON document to stdout; numbers that are not finite become null."""
    text = json_text(document.model_dump(), indent=2)
    with _named(sys.stdout):
        sys.stdout.write(text + "\n")


@contextmanager
def progress_bar(title: str = "") -> Iterator[ProgressBar]:
    """Progress on stderr, shown only on a terminal; add a task to it, whose description follows the title."""
    columns = (
        TextColumn(f"{title} {{task.description}}".lstrip(), markup=False),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
    )
    with ProgressBar(
        *columns,
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=notes,
        transient=True,
        disable=not notes.is_terminal,
    ) as bar:
        yield bar


def staged_progress(bar: ProgressBar) -> Progress:
    """One line on a bar, called with what is done now and the share of it; None where the end is not known."""
    task = bar.add_task("", total=None)

    def update(stage: str, share: float | None) -> None:
        bar.update(task, description=stage, total=None if share is None else 1.0, completed=share or 0.0)

    return update
