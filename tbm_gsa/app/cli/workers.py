"""What the commands with a campaign have in common: options of its workers, its progress, how it is started."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated

import typer
from rich.progress import Progress as ProgressBar
from rich.progress import TaskID

from tbm_gsa.sensitivity.study.campaign import Progress

Workers = Annotated[int, typer.Option("--workers", min=1, help="Processes.")]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", help="Dask scheduler, as tcp://host:8786: its workers simulate, no processes here."),
]


class _Line:
    """A line of a progress bar that appears with its first number.

    What was done before then, by a study that was interrupted, says nothing about the speed of this one.
    """

    def __init__(self, bar: ProgressBar) -> None:
        self._bar = bar
        self._task: TaskID | None = None

    def show(self, text: str, done: int, total: int) -> None:
        if self._task is None:
            self._task = self._bar.add_task(text, total=total, completed=done)
        self._bar.update(self._task, completed=done, description=text)


def campaign_progress(bar: ProgressBar) -> Progress:
    """Give what shows a campaign as a line of a progress bar."""
    line = _Line(bar)

    def update(done: int, total: int, failed: int) -> None:
        line.show(f"simulations {done} of {total}" + (f", {failed} failed" if failed else ""), done, total)

    return update


def analysis_progress(bar: ProgressBar) -> Callable[[int, int], None]:
    """Give what shows the analysis after a campaign as a line of a progress bar."""
    line = _Line(bar)

    def update(done: int, total: int) -> None:
        line.show(f"analysis {done} of {total} outputs", done, total)

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
