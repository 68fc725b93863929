"""`tbm-monitor doctor`: what is installed and whether it works here."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from tbm_gsa.app.cli.output import JSON_OPTION, print_json, results
from tbm_gsa.app.cli.processes import NodeCommand, NodeProcesses, settle_ros_environment
from tbm_gsa.app.cli.shipped import shipped_bag
from tbm_gsa.provenance import package_versions, versions_text
from tbm_gsa.reading import Part
from tbm_msgs_py.base.errors import RunError
from tbm_msgs_py.nodes.transport import DISCOVERY_RANGE
from tbm_msgs_py.topics import absolute

SENDER = "tbm_gsa.app.nodes.exchange"
_PATIENCE_S = 60.0  # for a block of another process; it starts in seconds, on a busy computer too

_PACKAGES = (  # ROS from the system has no Python package of that name
    "tbm_monitor",
    "numpy",
    "scipy",
    "numba",
    "scikit-learn",
    "SALib",
    "mcap",
    "rosbags",
    "ros-rclpy",
    "ros-rmw-fastrtps-cpp",
)


class Check(Part):
    """One check: whether it is passed, and what was found or is wrong."""

    ok: bool
    detail: str


class Diagnosis(Part):
    """What `doctor --json` prints; `ok` when all checks are."""

    ok: bool
    checks: dict[str, Check]
    versions: dict[str, str]


def doctor(json: Annotated[bool, JSON_OPTION] = False) -> None:
    """Check the installation; exit code 2 when something that the commands need is missing."""
    checks = {}
    for name, check in _CHECKS.items():
        checks[name] = _attempt(check)
        if not json:  # each as it is known: the first compiles for a while
            _print_check(name, checks[name])
    found = Diagnosis(
        ok=all(check.ok for check in checks.values()), checks=checks, versions=package_versions(_PACKAGES)
    )
    if json:
        print_json(found)
    else:
        results.print(f"versions: {versions_text(found.versions)}", highlight=False)
    if not found.ok:
        raise typer.Exit(2)


def _print_check(name: str, check: Check) -> None:
    results.print(f"{'ok  ' if check.ok else 'FAIL'} {name}: {check.detail}", highlight=False)


def _attempt(check: Callable[[], str]) -> Check:
    try:
        return Check(ok=True, detail=check())
    except Exception as error:  # noqa: BLE001 - whatever is wrong is the answer
        return Check(ok=False, detail=" ".join(f"{type(error).__name__}: {error}".split()))


def _ros() -> str:
    discovery = os.environ.get(DISCOVERY_RANGE) or "LOCALHOST, as for run and demo"
    settle_ros_environment()
    topic = absolute(f"doctor/block_{os.getpid()}")  # beside another doctor
    seconds = exchange(NodeCommand("doctor_sender", {"topic": topic}, module=SENDER), topic, _PATIENCE_S)
    return f"a block of another process came after {seconds:.1f} s; domain {_domain()}, discovery {discovery}"


def exchange(sender: NodeCommand, topic: str, patience: float, clock: Callable[[], float] = time.monotonic) -> float:
    """Seconds until a block of a process that is started for it has come.

    Raises
    ------
    RunError
        None came: the process ended, was not discovered, or was, and its messages did not arrive.
    """
    from tbm_gsa.app.nodes.exchange import receive_block  # noqa: PLC0415 - a check, not a dependency of this command

    with (
        tempfile.TemporaryDirectory(prefix="tbm_monitor.") as folder,
        NodeProcesses(Path(folder), kept=False) as processes,
    ):
        processes.start(sender)
        found = receive_block(topic, patience, processes.check, clock)
    if found.seconds is not None:
        return found.seconds
    if found.discovered:
        raise RunError(
            f"transport: another process was discovered, but no message of it came within {patience:g} s on domain "
            f"{_domain()}; allowed: UDP on this computer, and /dev/shm where the environment asks for shared memory"
        )
    raise RunError(
        f"discovery: another process was not seen within {patience:g} s on domain {_domain()}; allowed: UDP on this "
        "computer, which no firewall and no sandbox closes"
    )


def _domain() -> str:
    return os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"


def _model() -> str:
    from tbm_dynamics import load_machine, simulate  # noqa: PLC0415 - compiles for seconds on a cold cache

    response = simulate(load_machine("dz101"), duration=0.01)
    return f"dz101 runs, {response.states} states"


def _recording() -> str:
    from tbm_msgs_py.recordings.recording import read_recording  # noqa: PLC0415

    recording = read_recording(shipped_bag())
    return f"{recording.path.name} holds {recording.messages} messages of {len(recording.points)} test points"


def _cores() -> str:
    free = shutil.disk_usage(".").free / 1e9
    if free < 1.0:
        raise OSError(f"only {free:.1f} GB free here; recordings and studies need 1 GB")
    return f"{os.cpu_count()} cores, {free:.0f} GB free here"


_CHECKS: dict[str, Callable[[], str]] = {
    "computer": _cores,
    "model": _model,
    "recording": _recording,
    "ros": _ros,
}
