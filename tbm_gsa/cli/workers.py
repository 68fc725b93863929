"""What the commands with a campaign have in common: options of its workers, its progress, how it is started."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

import typer
from rich.progress import Progress as ProgressBar

from tbm_gsa.study.campaign import Progress

Workers = Annotated[int, typer.Option("--workers", min=1, help="Processes.")]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", help="Dask scheduler, as tcp://host:8786: its workers are used instead of processes."),
]


def campaign_progress(bar: ProgressBar) -> Progress:
    """Add a task to a progress bar and give what moves it."""
    task = bar.add_task("", total=None)

    def update(done: int, total: int, failed: int) -> None:
        if bar.tasks[0].total is None:
            # What an interrupted study had done says nothing about the speed of this one.
            bar.reset(task, total=total, completed=done)
        text = f"{done} of {total}" + (f", {failed} failed" if failed else "")
        bar.update(task, completed=done, description=text)

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
