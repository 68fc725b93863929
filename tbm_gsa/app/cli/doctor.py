"""`tbm-monitor doctor`: what is installed and whether it works here."""

from __future__ import annotations

import os
import platform
import shutil
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated, Any

import typer

from tbm_gsa.app.cli.output import JSON_OPTION, print_json, results
from tbm_gsa.app.cli.shipped import shipped_bag

_PACKAGES = (
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


def doctor(json: Annotated[bool, JSON_OPTION] = False) -> None:
    """Check the installation; exit code 2 when something that the commands need is missing."""
    checks = {}
    for name, check in _CHECKS.items():
        checks[name] = _attempt(check)
        if not json:  # each as it is known: the first compiles for a while
            _print_check(name, checks[name])
    document: dict[str, Any] = {
        "ok": all(check["ok"] for check in checks.values()),
        "checks": checks,
        "versions": _versions(),
    }
    if json:
        print_json(document)
    else:
        results.print(
            "versions: " + ", ".join(f"{name} {found}" for name, found in document["versions"].items()), highlight=False
        )
    if not document["ok"]:
        raise typer.Exit(2)


def _print_check(name: str, check: dict[str, Any]) -> None:
    results.print(f"{'ok  ' if check['ok'] else 'FAIL'} {name}: {check['detail']}", highlight=False)


def _attempt(check: Callable[[], str]) -> dict[str, Any]:
    try:
        return {"ok": True, "detail": check()}
    except Exception as error:  # noqa: BLE001 - whatever is wrong is the answer
        return {"ok": False, "detail": " ".join(f"{type(error).__name__}: {error}".split())}


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # ROS from the system has no Python package of that name
            continue
    return found


def _ros() -> str:
    import rclpy  # noqa: PLC0415 - a check, not a dependency of this command

    rclpy.init(args=[])
    try:
        node = rclpy.create_node("tbm_doctor")
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    discovery = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "not set: LOCALHOST for run and demo")
    return f"a node starts; domain {domain}, discovery {discovery}"


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
