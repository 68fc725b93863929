"""What the commands with a campaign have in common: options of its workers, its progress, how it is started."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

import typer
from rich.progress import Progress as ProgressBar
from rich.progress import TaskID

from tbm_msgs_py.base.progress import Progress

Workers = Annotated[int, typer.Option("--workers", min=1, help="Processes.")]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", help="Dask scheduler, as tcp://host:8786: its workers simulate, no processes here."),
]


def shown_progress(bar: ProgressBar) -> Progress:
    """Progress of a study on a bar: a line for the campaign and one for the analysis.

    A line appears with its first number: what an interrupted study did before then says nothing about the speed of
    this one.
    """
    lines: dict[str, TaskID] = {}

    def update(message: str, fraction: float | None) -> None:
        phase, done = message.partition(" ")[0], round(1000 * (fraction or 0.0))
        if phase not in lines:
            lines[phase] = bar.add_task(message, total=1000, completed=done)
        bar.update(lines[phase], completed=done, description=message)

    return update


@contextmanager
def anonymous_main() -> Iterator[None]:
    """Keep worker processes from importing the command line, which takes longer than a dozen simulations.

    A process that is spawned imports the main module of its parent unless that has neither a name nor a file.
    """
    main = sys.modules["__main__"]
    hidden = {key: vars(main).get(key) for key in ("__spec__", "__file__")}
    vars(main).update(dict.fromkeys(hidden))
    try:
        yield
    finally:
        vars(main).update(hidden)
