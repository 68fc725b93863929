"""Nodes in processes of their own."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from processes import NodeProcess, ros_text


@contextmanager
def node_runner(folder: Path) -> Iterator[Callable[..., NodeProcess]]:
    """Start nodes by module, with parameters as keywords; whatever still runs afterwards has to end on a signal."""
    started: list[NodeProcess] = []

    def start(module: str, *arguments: str, **parameters: object) -> NodeProcess:
        ros = [part for name, value in parameters.items() for part in ("-p", f"{name}:={ros_text(value)}")]
        node = NodeProcess(folder / f"node{len(started)}.log", module, ["--ros-args", *arguments, *ros])
        started.append(node)
        return node

    yield start
    running = [node for node in started if node.process.poll() is None]
    for place, node in enumerate(running):
        node.send((signal.SIGINT, signal.SIGTERM)[place % 2])
    faults = [fault for node in running if (fault := node.fault_at_end())]
    assert not faults, "\n".join(faults)


@pytest.fixture
def run_node(tmp_path: Path) -> Iterator[Callable[..., NodeProcess]]:
    """Nodes of one test."""
    with node_runner(tmp_path) as start:
        yield start
