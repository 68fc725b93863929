"""Reference pages that are made from the code when the documentation is built: they cannot go stale."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from pydantic import BaseModel

from tbm_dynamics.machine.summary import MachineSummary
from tbm_gsa.app.cli.bag.import_ import ImportResult
from tbm_gsa.app.cli.bag.info import BagContents, ScannedBag
from tbm_gsa.app.cli.bag.play import PlayResult
from tbm_gsa.app.cli.bag.record import RecordResult
from tbm_gsa.app.cli.bag.recover import RecoveryResult
from tbm_gsa.app.cli.demo import DemoResult
from tbm_gsa.app.cli.doctor import Diagnosis
from tbm_gsa.app.cli.gsa_shards import ShardResult
from tbm_gsa.app.cli.history import ExportResult
from tbm_gsa.app.cli.machine import CheckedMachine, MachineList
from tbm_gsa.app.cli.machine_update import UpdateResult
from tbm_gsa.app.cli.main import app as command_line
from tbm_gsa.app.cli.run import RunResult
from tbm_gsa.app.cli.simulate import SimulationResult
from tbm_gsa.comparison.results import ComparisonResult
from tbm_gsa.explanation.observability_result import Observability
from tbm_gsa.explanation.result import Explanation
from tbm_gsa.history.event_list import EventList
from tbm_gsa.history.summary import BaselineList, BaselineSummary, HistorySummary
from tbm_gsa.paper.load_summary import LoadSummary
from tbm_gsa.paper.reproduction.result import ReproductionResult
from tbm_gsa.sensitivity.results import StudyResult
from tbm_gsa.sensitivity.study.merging import MergeResult
from tbm_msgs_py.nodes.parameters import node_parameters
from tbm_msgs_py.nodes.registry import NODES

if TYPE_CHECKING:
    from sphinx.application import Sphinx

RESULTS: dict[str, type[BaseModel]] = {
    "demo": DemoResult,
    "run": RunResult,
    "simulate": SimulationResult,
    "compare": ComparisonResult,
    "gsa run": StudyResult,
    "gsa explain": Explanation,
    "gsa shard": ShardResult,
    "gsa merge": MergeResult,
    "bag info": BagContents,
    "bag info --scan": ScannedBag,
    "bag import": ImportResult,
    "bag recover": RecoveryResult,
    "bag record": RecordResult,
    "bag play": PlayResult,
    "machine list": MachineList,
    "machine show": MachineSummary,
    "machine check": CheckedMachine,
    "machine loads": LoadSummary,
    "machine update": UpdateResult,
    "machine observe": Observability,
    "history": HistorySummary,
    "history export": ExportResult,
    "history baseline list": BaselineList,
    "history baseline show": BaselineSummary,
    "events": EventList,
    "events ack": EventList,
    "reproduce": ReproductionResult,
    "doctor": Diagnosis,
}
"""Model of the document that a command prints."""


def command_page() -> str:
    """Every command with its arguments and options, as `--help` has them."""
    lines = [
        "# Command line",
        "",
        "Made from the commands themselves; `tbm-monitor COMMAND --help` says the same.",
        "",
        "Exit codes: 0 success; 2 bad input, said in one line with what is allowed; 1 a fault of the program,",
        "in one line that names the error of the library; 130 after Ctrl-C, but 0 for `run`, `bag record` and",
        "`bag play`, which go on until they are told to end.",
        "",
    ]
    for names, command in commands():
        lines += [f"## {' '.join(['tbm-monitor', *names])}", "", _sentence(command.help or ""), ""]
        lines += _table(
            ("argument or option", "default", "what"),
            (_parameter_row(parameter) for parameter in command.params if parameter.name != "help"),
        )
    return "\n".join(lines)


def commands(group: Any = None, names: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Names and click command of everything that can be called, groups that do something by themselves included."""
    group = group or typer.main.get_command(command_line)
    for name, command in group.commands.items():
        path = (*names, name)
        if not hasattr(command, "commands"):
            yield path, command
            continue
        if command.invoke_without_command:
            yield path, command
        yield from commands(command, path)


def parameter_page() -> str:
    """Parameters of every node, with type, range and default."""
    lines = [
        "# Parameters of the nodes",
        "",
        "Made from the declarations of the nodes. Every node has `autostart` (default true): it configures and"
        " activates itself, without a lifecycle manager. Set them with `--ros-args -p name:=value`, a parameter file"
        " (`config/nodes.yaml`) or the launch files; those marked *live* may change at run time, the others between"
        " `cleanup` and `configure`.",
        "",
    ]
    for node in NODES.values():
        rows = (
            (
                f"`{entry.name}`" + (" *live*" if entry.changes == "running" else ""),
                _code(entry.default),
                _cell(entry.allowed()),
                _cell(entry.description),
            )
            for entry in node_parameters(node.name).values()
            if entry.name != "autostart"
        )
        lines += [f"## {node.name}", "", node.summary, "", *_table(("parameter", "default", "allowed", "what"), rows)]
    return "\n".join(lines)


def schema_page() -> str:
    """JSON schema of every result."""
    lines = ["# JSON schemas", "", "Made from the models that write and read the results of `--json`.", ""]
    for command, result in RESULTS.items():
        found = json.dumps(result.model_json_schema(mode="serialization"))
        schema = json.dumps(
            json.loads(found, parse_constant=lambda _: None), indent=1, ensure_ascii=False
        )  # NaN is null
        lines += [f"## {command}", "", "```json", schema, "```", ""]
    return "\n".join(lines)


PAGES = {
    "reference/command_line.md": command_page,
    "reference/parameters.md": parameter_page,
    "reference/schemas.md": schema_page,
}


def write_pages(app: Sphinx) -> None:
    """Write the pages whose text has changed."""
    for name, make in PAGES.items():
        path, text = Path(app.srcdir) / name, make()
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Make the pages before any is read."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _parameter_row(parameter: Any) -> tuple[str, str, str]:
    names = [*parameter.opts, *parameter.secondary_opts]
    if parameter.param_type_name == "argument":
        names = [parameter.name.upper()]
    default = "required" if parameter.required else _code(parameter.default)
    return " ".join(f"`{name}`" for name in names), default, _cell(getattr(parameter, "help", "") or "")


def _table(headings: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[str]:
    lines = ["| " + " | ".join(cells) + " |" for cells in (headings, ("---",) * len(headings), *rows)]
    return [*lines, ""]


def _code(value: Any) -> str:
    if value is None or value in ("", [""]):
        return "–"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f"`{value}`"


def _cell(text: str) -> str:
    return _sentence(text).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*").replace("$", "\\$")


def _sentence(text: str) -> str:
    return " ".join(text.split())
