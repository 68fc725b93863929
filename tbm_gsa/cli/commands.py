"""The commands by name, each imported when it is asked for: together their imports take seconds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup

# A module holds a group of commands as `app`, or one command as a function of its name.
HOMES = {
    name: f"tbm_gsa.cli.{name}"
    for name in ("demo", "run", "simulate", "compare", "gsa", "bag", "machine", "history", "reproduce", "doctor")
}


@cache
def load(name: str) -> Any:
    """Import a command."""
    module = import_module(HOMES[name])
    group = getattr(module, "app", None)
    if group is None:
        group = typer.Typer(add_completion=False)
        group.command(name)(getattr(module, name))
    command = typer.main.get_command(group)
    command.name = name
    return command


class _OnDemand(Mapping[str, Any]):
    """All commands, by name."""

    def __getitem__(self, name: str) -> Any:
        return load(name)

    def __contains__(self, name: object) -> bool:
        return name in HOMES

    def __iter__(self) -> Iterator[str]:
        return iter(HOMES)

    def __len__(self) -> int:
        return len(HOMES)


class CommandLine(TyperGroup):
    """The whole command line."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**{**given, "commands": None})
        self.commands = _OnDemand()  # type: ignore[assignment]  # nothing is ever added to it

    def list_commands(self, ctx: Any) -> list[str]:  # noqa: ARG002
        """Names in the order of the help."""
        return list(self.commands)
