"""Machine descriptions for the tests: the shipped file as plain data, edited copies, and a small machine."""

import copy
from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np
import yaml

from tbm_dynamics import Machine
from tbm_dynamics.loads.cutters.head import wrench_rows
from tbm_dynamics.loads.description import COMPONENTS
from tbm_dynamics.machine.description import MachineDescription
from tbm_dynamics.mesh.planetary import PlanetaryStage

RIG = Path(__file__).parents[1] / "machines" / "rig.yaml"
"""A gear rig: one drive, lightly damped, connections under names of its own."""
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


def plain(name="dz101"):
    """A shipped file, or one at a path, as nested dictionaries and lists, read by PyYAML alone."""
    return copy.deepcopy(_read(name))


@cache
def _read(name):
    file = name if isinstance(name, Path) else resources.files("tbm_dynamics") / "machines" / f"{name}.yaml"
    text = file.read_text("utf-8")
    return numbers(yaml.safe_load(text))


def built(data):
    """Machine of edited data."""
    return Machine(MachineDescription.model_validate(copy.deepcopy(data)))


def stage_of(sun, planet, planets, ring=None, module=0.007, degrees=20.0, width=0.14, grade=6):
    """A planetary stage; without a ring the one that fits."""
    return PlanetaryStage(
        sun_teeth=sun,
        planet_teeth=planet,
        ring_teeth=ring or sun + 2 * planet,
        planets=planets,
        module=module,
        pressure_angle_deg=degrees,
        face_width=width,
        accuracy_grade=grade,
        source="test",
    )


def head_wrench(layout, normal, rolling, side=0.0):
    """Sum (6,) of forces (n,) on the discs with the head at angle 0, N and N·m."""
    forces = np.array([np.broadcast_to(part, layout.radius.shape) for part in (normal, rolling, side)])
    return np.einsum("kn,knc->c", forces, wrench_rows(layout))


def with_cutters(head, **changes):
    """A head whose description has other values."""
    return replace(head, description=head.description.model_copy(update=changes))


def groups(data):
    """The places of a file that hold connections between nodes."""
    return data["cutterhead_bearing_gear"], data["carrier_girder"], data


def all_connections(data):
    """Every connection between nodes, in and between the subsystems."""
    return [connection for group in groups(data) for connection in group.get("connections", [])]


def without(data, *connections):
    """A copy without the connections (name, first node)."""
    fewer = copy.deepcopy(data)
    for group in groups(fewer):
        kept = [c for c in group["connections"] if (c["name"], c["between"][0]) not in connections]
        group["connections"] = kept
    assert len(all_connections(fewer)) == len(all_connections(data)) - len(connections)
    return fewer


def quiet(data):
    """A copy whose loads do not fluctuate."""
    calm = copy.deepcopy(data)
    for load in (calm["loads"][name] for name in COMPONENTS):
        load["regions"], load["lines"] = [], []
    return calm


def bare(data):
    """A copy without what a file need not state: motors give torque alone, thrust and torque act on the head alone."""
    less = copy.deepcopy(data)
    less["driveshaft"].pop("motor", None)
    for connection in all_connections(less):
        connection.pop("force_controlled", None)
        connection.pop("turning_inertia", None)
    return less


def settling():
    """The shipped file, but that the wind-up of girder and gripper settles as fast as any slip of the motors can do."""
    data = plain()
    data["driveshaft"]["motor"]["damping"] = 9e4
    return data


def small():
    """Bare machine of two drives, one ring, one carrier: 14 nodes, so that a general ODE solver manages all of it."""
    data = bare(quiet(plain()))
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
    by_name = {connection["name"]: connection for connection in all_connections(data)}
    rock, bearing, bolt = by_name["k_r_ct"], by_name["k_b_io"], by_name["k_c_bc"]
    head["connections"] = [rock]
    carrier["connections"] = [
        {**bolt, "between": [10, 12]},
        {**rock, "name": "k_r_gd", "between": [12, "ground"], "stiffness": [1e10, 5e9, 5e9, 1e10, 5e10, 5e10]},
    ]
    data["connections"] = [{**bearing, "between": [8, 10]}]
    data["test_points"] = {"cutterhead": 1}
    return data


def rock(data):
    """The connections to the ground by their node."""
    return {c["between"][0]: c for c in all_connections(data) if c["between"][1] == "ground"}


def brake(data):
    """Damper about x of the rock at the head, which a turning inertia is stated for, N·m·s/rad."""
    head = rock(data)[1]
    return 2.0 * data["connection_damping"]["rock"] * np.sqrt(head["stiffness"][3] * head["turning_inertia"])


def static_mesh_force(machine):
    """T/(n r_b) from the file's numbers, N."""
    drive = machine.description.driveshaft
    base = drive.gear.module * drive.gear.ring_teeth / 2.0 * np.cos(np.radians(drive.gear.pressure_angle_deg))
    return machine.description.operating_point.torque_kn_m * 1e3 / (drive.count * base)
