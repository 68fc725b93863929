"""Nodes in processes of their own."""

import gc
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from peer import HostedNode, Peer
from processes import NodeProcess, ros_arguments


@contextmanager
def node_runner(folder: Path) -> Iterator[Callable[..., NodeProcess]]:
    """Start nodes by module, with parameters as keywords; whatever still runs afterwards has to end on a signal."""
    started: list[NodeProcess] = []

    def start(module: str, *arguments: str, **parameters: object) -> NodeProcess:
        node = NodeProcess(folder / f"node{len(started)}.log", module, ros_arguments(arguments, parameters))
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


@pytest.fixture
def peer() -> Iterator[Peer]:
    """Node of the test process."""
    with Peer() as made:
        yield made


@pytest.fixture
def host_node(peer: Peer) -> Callable[..., HostedNode]:
    """Nodes of one test that its peer spins, with parameters as keywords."""
    return peer.host


@pytest.fixture(autouse=True, scope="module")
def participants_end_with_their_module() -> Iterator[None]:
    """Collect the contexts that tests have shut down: until then their DDS participants are there for others."""
    yield
    gc.collect()
