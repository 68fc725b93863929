"""Machine descriptions for the tests: the shipped file as plain data, edited copies, and a small machine."""

import copy
from importlib import resources

import numpy as np
import yaml

from tbm_dynamics import Machine
from tbm_dynamics.machine.description import MachineDescription

TEXT = (resources.files("tbm_dynamics") / "machines" / "dz101.yaml").read_text("utf-8")


def numbers(value):
    """Plain YAML 1.1 reads 1e9 as a string; make it the number it is."""
    if isinstance(value, dict):
        return {key: numbers(part) for key, part in value.items()}
    if isinstance(value, list):
        return [numbers(part) for part in value]
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def plain():
    """The dz101 file as nested dictionaries and lists, read by PyYAML alone."""
    return numbers(yaml.safe_load(TEXT))


def built(data):
    """Machine of edited data."""
    return Machine(MachineDescription.model_validate(copy.deepcopy(data)))


def without(data, *connections):
    """A copy without the connections (name, first node)."""
    kept = [c for c in data["connections"] if (c["name"], c["between"][0]) not in connections]
    assert len(kept) == len(data["connections"]) - len(connections)
    return {**copy.deepcopy(data), "connections": kept}


def quiet(data):
    """A copy whose loads do not fluctuate."""
    calm = copy.deepcopy(data)
    for load in calm["loads"].values():
        load["regions"], load["lines"] = [], []
    return calm


def small():
    """Two drives, one ring, one carrier: 14 nodes, so that a general ODE solver manages the whole of it."""
    data = quiet(plain())
    head, carrier = data["cutterhead_bearing_gear"], data["carrier_girder"]
    head["nodes"] = {1: [0.0, 0.0, 0.0], 8: [-2.5, 0.0, 0.0]}
    head["shafts"] = [
        {"nodes": [1, 8], "outer_diameter": 4.0, "inner_diameter": 3.4, "mass": 40e3, "source": "assumed"}
    ]
    carrier["nodes"] = {10: [-2.8, 0.0, 0.0], 12: [-4.0, 0.0, 0.0]}
    carrier["shafts"] = []
    carrier["bodies"] = [
        {"node": node, "mass": mass, "inertia": [2 * mass, mass, mass], "source": "assumed"}
        for node, mass in ((10, 12e3), (12, 60e3))
    ]
    data["driveshaft"].update(count=2, ring_shaft_nodes=[8])
    rock, bearing = data["connections"][0], next(c for c in data["connections"] if c["name"] == "k_b_io")
    bolt = next(c for c in data["connections"] if c["name"] == "k_c_bc")
    data["connections"] = [
        rock,
        {**bearing, "between": [8, 10]},
        {**bolt, "between": [10, 12]},
        {**rock, "name": "k_r_gd", "between": [12, "ground"], "stiffness": [1e10, 5e9, 5e9, 1e10, 5e10, 5e10]},
    ]
    data["test_points"] = {"cutterhead": 1}
    return data


def static_mesh_force(machine):
    """T/(n r_b) from the file's numbers, N."""
    drive = machine.description.driveshaft
    base = drive.gear.module * drive.gear.ring_teeth / 2.0 * np.cos(np.radians(drive.gear.pressure_angle_deg))
    return machine.description.operating_point.torque_kn_m * 1e3 / (drive.count * base)
