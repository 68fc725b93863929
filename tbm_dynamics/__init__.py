"""Dynamics of the driving system of a tunnel boring machine."""

from typing import TYPE_CHECKING

from tbm_msgs_py.base.lazy import lazy_names

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

# What reads a machine or makes its loads needs nothing that integrates.
__getattr__ = lazy_names(
    __name__,
    {
        "tbm_dynamics.integration.simulator": "Simulator",
        "tbm_dynamics.machine.loading": "shipped_machines",
        "tbm_dynamics.machine.machine": "Machine load_machine",
        "tbm_dynamics.response": "Response",
        "tbm_dynamics.streaming.simulation": "simulate",
        "tbm_msgs_py.base.errors": "MachineError SimulationError",
        "tbm_msgs_py.base.operating_point": "OperatingPoint",
    },
)
