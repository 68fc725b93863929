"""Settings of the analysis node, the live view and the page to watch."""

from __future__ import annotations

import os
import shlex
from typing import Annotated, Literal
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field

from tbm_msgs_py import topics
from tbm_msgs_py.base.fields import FrozenModel
from tbm_msgs_py.base.texts import LONGEST_NAME, quoted
from tbm_msgs_py.nodes.parameters import (
    MachineSettings,
    Names,
    NodeSettings,
    WritingSettings,
    each_once,
    live_parameter,
    parameter,
)

OFF = "none"
"""History file of a node that keeps none."""
_Axes = Annotated[tuple[Literal["x", "y", "z"], ...], Field(min_length=1), AfterValidator(each_once)]
_MOST_WORKERS = max(2, os.cpu_count() or 1)


def _named(name: str) -> str:
    if not (name.strip() and name.isprintable() and len(name) <= LONGEST_NAME):
        raise ValueError(f"{quoted(name)}, allowed: a name of 1 to {LONGEST_NAME} printable characters")
    return name


def _command_line(command: str) -> str:
    try:
        shlex.split(command)
    except ValueError as error:  # a quote that is not closed
        raise ValueError(f"{quoted(command)}: {error}, allowed: a program and its arguments") from None
    return command


def _web_address(address: str) -> str:
    parts = urlsplit(address)
    if address and not (parts.scheme in ("http", "https") and parts.hostname and address.isprintable()):
        raise ValueError(f"{quoted(address)}, allowed: an address such as http://127.0.0.1:8000/events")
    return address


def _listening(host: str) -> str:
    if not host.strip():  # asyncio would listen everywhere
        raise ValueError(f"{quoted(host)}, allowed: an address or name of this computer, 0.0.0.0 for all of them")
    return host


_Name = Annotated[str, AfterValidator(_named)]


class GsaSettings(FrozenModel):
    """The sensitivity analyses that the node starts."""

    on_threshold: bool = live_parameter(True, "explain an alarm and start the sensitivity analysis when it is raised")
    pause: float = live_parameter(
        60.0, "least time from the start of a study to one that an alarm starts (min)", low=0.0, high=100000.0
    )
    samples: int = live_parameter(200, "training simulations", low=10, high=100000)
    test: int = live_parameter(20, "test simulations", low=2, high=100000)
    duration: float = live_parameter(3.0, "length of a simulation (s)", low=0.1, high=600.0)
    inputs: str = live_parameter("", "file that defines a study as `gsa run --inputs`; empty: the machine's inputs")
    outputs: Names = live_parameter((), "outputs analysed; empty: those of gsa.inputs, else the eight indicators")
    seed: int = live_parameter(0, "seed of design and loads", low=0, high=2**31 - 1)
    quick: bool = live_parameter(False, "indices of the best surrogates only, as `gsa run --quick`")
    common_loads: bool = live_parameter(False, "one realisation of the loads for all simulations")
    workers: int = live_parameter(2, "processes, one a core at most", low=1, high=_MOST_WORKERS)
    folder: str = live_parameter("tbm_gsa_studies", "folder that gets one folder a study", written=True, no_path=())


class WatchSettings(FrozenModel):
    """The watch for a change of the machine: the sequential alarm, and what stands behind it."""

    baseline: _Name = live_parameter(
        "commissioning",
        "name of the commissioning that the machine is held against; learnt where there is none of that name yet",
    )
    commissioning: float = live_parameter(
        4.0, "steady boring that a baseline is learnt from, at each level of operation (h)", low=0.5, high=1000.0
    )
    false_alarm: float = live_parameter(
        30.0, "mean time from one false alarm to the next, of boring (d)", low=0.1, high=3650.0
    )
    workers: int = live_parameter(
        2, "processes that compute the machine at a new level of operation", low=1, high=_MOST_WORKERS
    )


class EventSettings(FrozenModel):
    """Whom the site tells of events: nobody who can reach the node over ROS may set it."""

    command: Annotated[str, AfterValidator(_command_line)] = parameter(
        "",
        "program and arguments, run without a shell when an event begins or ends; it gets the event as JSON on stdin",
        changes="start",
    )
    post: Annotated[str, AfterValidator(_web_address)] = parameter(
        "", "http or https address that gets the event as JSON in a POST", changes="start"
    )


class SnapshotSettings(FrozenModel):
    """Recordings of the moments of events."""

    folder: str = parameter(
        "", "folder of the recordings of events; empty: snapshots beside the history, none without one", written=True
    )
    quota: float = parameter(
        2000.0, "what they may take on the disk, the newest are kept; 0: none are made (MB)", low=0.0, high=1e9
    )
    before: float = parameter(60.0, "recorded time before an event (s)", low=1.0, high=3600.0)
    after: float = parameter(30.0, "recorded time after it (s)", low=0.0, high=3600.0)
    memory: float = parameter(
        80.0, "memory for what may have to be recorded; more comes in a shorter time (MB)", low=1.0, high=100000.0
    )


class AnalysisSettings(MachineSettings, WritingSettings):
    """Parameters of `analysis_node`."""

    window: float = live_parameter(topics.WINDOW, "length of a comparison window (s)", low=0.1, high=3600.0)
    alarm: Literal["sequential", "threshold"] = live_parameter(
        "sequential",
        "rule of the alarm: a sequential test for a change of the machine, or the level of a point over a threshold",
    )
    threshold: float = live_parameter(
        topics.ERROR_THRESHOLD,
        "share by which measured and computed RMS must differ to count (1)",
        low=0.001,
        high=100.0,
    )
    threshold_windows: int = live_parameter(
        topics.ERROR_WINDOWS, "windows in a row over the threshold that raise the alarm", low=1, high=10000
    )
    alarm_axes: _Axes = live_parameter(("x",), "axes whose level is watched; the paper compares the axial one, x")
    mapping: str = parameter(
        "", "mapping file of the field topics; empty: the topics of the contract, m/s², gravity removed"
    )
    history: str = parameter(
        "",
        "history file of the windows; empty: tbm_monitor/history.sqlite in the user's data folder; none: not kept",
        written=True,
        no_path=("", OFF),
    )
    history_days: float = parameter(90.0, "age at which live windows go; 0: never (d)", low=0.0, high=36500.0)
    baseline: str = live_parameter(
        "", "baseline in the history that the threshold is set against; empty: it is absolute"
    )
    watch: WatchSettings = WatchSettings()
    gsa: GsaSettings = GsaSettings()
    events: EventSettings = EventSettings()
    snapshot: SnapshotSettings = SnapshotSettings()


class LiveViewSettings(NodeSettings):
    """Parameters of `live_view`."""

    host: str = parameter("127.0.0.1", "address the server listens at; the default is this computer only")
    port: int = parameter(8765, "TCP port; 0 for a free one, which the log names", low=0, high=65535)
    blocks: bool = parameter(False, "show blocks too: no panel draws them, a recording may want them")


class WebViewSettings(MachineSettings):
    """Parameters of `web_view`: whom it lets in and what it reads is stated at the start, not over ROS."""

    host: Annotated[str, AfterValidator(_listening)] = parameter(
        "127.0.0.1", "address the server listens at; the default is this computer only", changes="start"
    )
    port: int = parameter(8080, "TCP port; 0 for a free one, which the log names", low=0, high=65535)
    names: Names = parameter(
        (), "names by which others may call this computer, beside its addresses and localhost", changes="start"
    )
    acknowledging: bool = parameter(True, "let whoever reaches the page acknowledge events", changes="start")
    folder: str = parameter(
        "tbm_gsa_studies", "folder whose pages of studies, explanations and comparisons are linked", changes="start"
    )
    history: str = parameter(
        "",
        "history file of trends and events; empty: tbm_monitor/history.sqlite in the user's data folder; none: without",
        changes="start",
    )
    mapping: str = parameter("", "mapping file of the field topics, that of the analysis node")
    alarm: Literal["sequential", "threshold"] = parameter(
        "sequential", "alarm of the analysis node: with threshold its limits are the expected levels"
    )
    threshold: float = parameter(topics.ERROR_THRESHOLD, "threshold of the analysis node (1)", low=0.001, high=100.0)
    baseline: str = parameter("", "baseline of the analysis node; empty: its threshold is absolute")
