"""The machine: description, loading, inputs."""

from tbm_dynamics.machine.loading import MachineError, shipped_machines
from tbm_dynamics.machine.machine import Machine, OperatingPoint, load_machine

__all__ = ["Machine", "MachineError", "OperatingPoint", "load_machine", "shipped_machines"]
