"""The commands by name, each imported when it is called: together their imports take seconds."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from typing import Any  # click's contexts: typer may carry a click of its own

import typer
from typer.core import TyperCommand, TyperGroup

from tbm_gsa.compiled import settle_compiled_folder

# In the order of the help, each with its line there. The module `tbm_gsa.app.cli.NAME` holds a group of commands as
# `app`, or one command as a function of its name.
LINES = {
    "demo": "The whole job on the shipped recording; ends by itself.",
    "run": "Loads, dynamics and analysis as ROS 2 nodes, live.",
    "simulate": "One run of the model: indicators and accelerations.",
    "compare": "A recording against the model, at every test point.",
    "gsa": "Surrogate-based global sensitivity analysis.",
    "bag": "Recordings on disk.",
    "machine": "Machine files: list, show, check, loads, update, observe.",
    "history": "Windows of all comparisons over time, and baselines.",
    "events": "What happened: alarms, changes of the rock, sensors; acknowledge.",
    "reproduce": "Tables and figures of the paper, each with a verdict.",
    "doctor": "Whether everything that the commands need is here.",
}


@cache
def load(name: str) -> TyperCommand | TyperGroup:
    """Import a command; KeyError for a name that is none."""
    line = LINES[name]
    settle_compiled_folder()
    module = import_module(f"tbm_gsa.app.cli.{name}")
    group = getattr(module, "app", None)
    if group is None:
        group = typer.Typer(add_completion=False)
        group.command(name)(getattr(module, name))
    command = typer.main.get_command(group)
    assert isinstance(command, TyperCommand | TyperGroup)  # noqa: S101 - typer makes no other
    command.name = name
    command.help = command.help or line  # a group that does nothing by itself has no more to say
    return command


class _OnDemand(Mapping[str, TyperCommand | TyperGroup]):
    """All commands, by name."""

    def __getitem__(self, name: str) -> TyperCommand | TyperGroup:
        return load(name)

    def __contains__(self, name: object) -> bool:
        return name in LINES

    def __iter__(self) -> Iterator[str]:
        return iter(LINES)

    def __len__(self) -> int:
        return len(LINES)


class CommandLine(TyperGroup):
    """The whole command line; its help imports none of the commands."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**{**given, "commands": None})
        self.commands = _OnDemand()  # type: ignore[assignment]  # nothing is ever added to it

    def list_commands(self, ctx: object) -> list[str]:  # noqa: ARG002
        """Names in the order of the help."""
        return list(self.commands)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help, with a line for each command in its place."""
        listing = copy.copy(self)
        listing.commands = {name: TyperCommand(name, help=line) for name, line in LINES.items()}
        TyperGroup.format_help(listing, ctx, formatter)
