"""The machine: description, loading, inputs."""

from tbm_dynamics.machine.loading import shipped_machines
from tbm_dynamics.machine.machine import Machine, load_machine
from tbm_msgs_py.base.errors import MachineError
from tbm_msgs_py.base.operating_point import OperatingPoint

__all__ = ["Machine", "MachineError", "OperatingPoint", "load_machine", "shipped_machines"]
