"""Dynamics of the driving system of a tunnel boring machine."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tbm_dynamics.integration.simulator import Simulator
    from tbm_dynamics.machine.loading import shipped_machines
    from tbm_dynamics.machine.machine import Machine, load_machine
    from tbm_dynamics.response import Response
    from tbm_dynamics.streaming.simulation import simulate
    from tbm_msgs_py.base.errors import MachineError, SimulationError
    from tbm_msgs_py.base.operating_point import OperatingPoint

__all__ = [
    "Machine",
    "MachineError",
    "OperatingPoint",
    "Response",
    "SimulationError",
    "Simulator",
    "load_machine",
    "shipped_machines",
    "simulate",
]

# Loaded on first use: what reads a machine or makes its loads needs nothing that integrates.
_HOME = {
    "Machine": "tbm_dynamics.machine.machine",
    "MachineError": "tbm_msgs_py.base.errors",
    "OperatingPoint": "tbm_msgs_py.base.operating_point",
    "Response": "tbm_dynamics.response",
    "SimulationError": "tbm_msgs_py.base.errors",
    "Simulator": "tbm_dynamics.integration.simulator",
    "load_machine": "tbm_dynamics.machine.machine",
    "shipped_machines": "tbm_dynamics.machine.loading",
    "simulate": "tbm_dynamics.streaming.simulation",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
