"""A geared rotor of the literature in two codes: described once, here put together by the assembler of the machines.

`reference/geared_rotor.json` describes it and holds the natural frequencies that ROSS finds; where that is installed
`benchmarks/against_ross.py` finds them anew.
"""

import json
from pathlib import Path

import numpy as np
from published_parts import add_spring, assembler_of, frequencies

from tbm_dynamics.mesh.geometry import ExternalPair

REFERENCE = Path(__file__).parent / "reference" / "geared_rotor.json"


def described():
    return json.loads(REFERENCE.read_text("utf-8"))


def our_frequencies(data):
    """Natural frequencies (Hz) of all unknowns, ascending."""
    mesh, rotors, steel = data["mesh"], data["rotors"], data["steel"]
    teeth = [rotor["gear"]["teeth"] for rotor in rotors]
    pair = ExternalPair(*teeth, mesh["module"], np.radians(mesh["pressure_angle_deg"]))
    # ROSS loads the other flank: this is the mirror image in z, in which bearings along y and z stay what they are.
    direction = -mesh["direction_rad"]
    apart = pair.centre_distance * np.array([0.0, np.cos(direction), np.sin(direction)])
    along = [np.concatenate([[0.0], np.cumsum(rotor["lengths"])]) for rotor in rotors]
    numbers = [100 * (i + 1) + np.arange(len(places)) for i, places in enumerate(along)]
    positions = {}
    for i, (rotor, places, nodes) in enumerate(zip(rotors, along, numbers, strict=True)):
        for node, place in zip(nodes, places - places[rotor["gear"]["node"]], strict=True):
            positions[int(node)] = i * apart + [place, 0.0, 0.0]
    parts = assembler_of(positions, steel["elasticity"], steel["shear_modulus"])
    for rotor, nodes in zip(rotors, numbers, strict=True):
        spans = zip(rotor["lengths"], rotor["outer_diameters"], rotor["inner_diameters"], strict=True)
        for i, (length, outer, inner) in enumerate(spans):
            mass = steel["density"] * np.pi / 4.0 * (outer**2 - inner**2) * length
            parts.add_shaft((int(nodes[i]), int(nodes[i + 1])), outer, inner, mass)
        for body in (*rotor["bodies"], rotor["gear"]):
            across = body["diametral"]
            parts.add_body(int(nodes[body["node"]]), body["mass"], (body["polar"], across, across))
        for bearing in rotor["bearings"]:
            stiffness = (bearing["axial"], *bearing["across"], 0.0, 0.0, 0.0)
            add_spring(parts, int(nodes[bearing["node"]]), None, stiffness)
    gears = [int(nodes[rotor["gear"]["node"]]) for rotor, nodes in zip(rotors, numbers, strict=True)]
    row = parts.mesh_row(*gears, pair, direction + np.pi)
    return frequencies(parts.M, parts.K + mesh["stiffness"] * np.outer(row, row), np.arange(len(parts.M)))
