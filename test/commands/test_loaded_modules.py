"""What a start loads: neither the help nor a node waits for libraries that it does not need.

Source: Python's own list of loaded modules in a fresh process.
"""

import re
import subprocess
import sys

import pytest

from tbm_gsa.app.cli.commands import LINES
from tbm_msgs_py.nodes.registry import NODES

# They take up to a second to import.
FITTED_AND_DRAWN = {"matplotlib", "PIL", "jinja2", "sklearn", "SALib", "pandas", "emcee", "distributed"}
FILTERED = {"scipy.interpolate", "scipy.optimize", "scipy.signal", "scipy.stats"}
COMPILING = {"load_node", "dynamics_node", "bag_player"}  # nodes that run compiled code
FILTERING = {"dynamics_node", "analysis_node"}


TOLD = "import atexit, sys; atexit.register(lambda: print(*sys.modules, file=sys.stderr))\n"
HELP = TOLD + "from tbm_gsa.app.cli.main import main; main()"


def loaded(program, *arguments):
    """Modules that a fresh process has loaded at its end, and what it printed."""
    command = [sys.executable, "-c", program, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return set(done.stderr.split()), done.stdout


def test_the_help_loads_no_command():
    modules, text = loaded(HELP, "--help")
    assert "tbm_gsa.app.cli.commands" in modules
    assert not {"numpy", "yaml", "pydantic", "tbm_dynamics", "tbm_msgs_py.topics", "tbm_msgs_py.bags"} & modules
    assert not {f"tbm_gsa.app.cli.{name}" for name in LINES} & modules
    for name, line in LINES.items():
        assert re.search(rf"\b{name} +{re.escape(line)}", text)


@pytest.mark.parametrize("command", LINES)
def test_the_help_of_a_command_waits_for_no_library(command):
    modules, _ = loaded(HELP, command, "--help")
    assert f"tbm_gsa.app.cli.{command}" in modules
    assert not (FITTED_AND_DRAWN | FILTERED | {"rclpy"}) & modules


def test_the_page_of_a_history_is_drawn_and_fits_nothing():
    modules, _ = loaded(f"{TOLD}import tbm_gsa.app.report.history_page, tbm_gsa.app.report.compare_page")
    assert "matplotlib" in modules
    assert not {"sklearn", "SALib", "pandas", "emcee", "distributed"} & modules


@pytest.mark.parametrize("node", NODES)
def test_a_node_loads_nothing_that_it_does_not_need(node):
    pytest.importorskip("rclpy")
    modules, _ = loaded(f"{TOLD}import {NODES[node].module}")
    assert NODES[node].module in modules
    assert not (FITTED_AND_DRAWN | {"typer", "rich"}) & modules
    assert ("numba" in modules) == (node in COMPILING)
    assert ("scipy.signal" in modules) == (node in FILTERING)
    assert node in FILTERING or not FILTERED & modules


FIRST_BLOCKS = {
    "loads": """
from tbm_dynamics import load_machine
from tbm_dynamics.streaming.streams import LoadStream

stream = LoadStream(load_machine("dz101"), 0, 1e-4, 500)
stream.next_block()

def work():
    stream.next_block()
""",
    "dynamics": """
from tbm_dynamics.machine.machine import load_machine
from tbm_dynamics.streaming.sensors import LiveFilter, SensorModel, SensorParameters
from tbm_dynamics.streaming.streams import DynamicsStream

stream = DynamicsStream(load_machine("dz101"), 1e4)
sensor = SensorModel(SensorParameters(packet_samples=50), 10000, 0, "girder")
slow = LiveFilter(1e4, 100)
stream.warm_up()

def work():
    for chunk in stream.process(1_000_000_000, np.tile(stream.mean_loads, (200, 1))):
        assert sensor.process(chunk.first_step, chunk.acceleration[:, 0, :3])
        assert slow.process(chunk.first_step, chunk.mesh_force)
""",
    "analysis": """
import tbm_gsa.app.nodes.analysis_node
from tbm_gsa.comparison import WindowedComparison

comparison = WindowedComparison(0.5)

def work():
    noise = np.random.default_rng(0).standard_normal((250, 3))
    blocks = [(source, number) for number in range(60) for source in ("model", "field")]
    assert any(comparison.feed("girder", s, k * 50_000_000, np.arange(250) / 5000, noise) for s, k in blocks)
""",
}
LOADED_BY_WORK = """
import numpy as np
{code}
before = set(sys.modules)
work()
print(*set(sys.modules) - before)
"""


@pytest.mark.parametrize("node", FIRST_BLOCKS)
def test_the_first_block_waits_for_no_import(node):
    pytest.importorskip("rclpy")
    _, text = loaded(TOLD + LOADED_BY_WORK.format(code=FIRST_BLOCKS[node]))
    assert text.split() == []


def test_loads_are_made_without_filters():
    modules, _ = loaded(TOLD + LOADED_BY_WORK.format(code=FIRST_BLOCKS["loads"]))
    assert (
        not (FITTED_AND_DRAWN | FILTERED | {"tbm_dynamics.integration.simulator", "tbm_dynamics.structure"}) & modules
    )
