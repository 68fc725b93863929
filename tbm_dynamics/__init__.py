"""Dynamics of the driving system of a tunnel boring machine."""

from tbm_dynamics.integration.errors import SimulationError
from tbm_dynamics.integration.simulator import Simulator
from tbm_dynamics.machine import Machine, MachineError, OperatingPoint, load_machine, shipped_machines
from tbm_dynamics.response import Response
from tbm_dynamics.simulation import simulate

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
