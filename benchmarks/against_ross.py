"""A geared rotor and a gear pair with backlash in ROSS, another code: what tests hold ours against.

ROSS (github.com/petrobras/ross, Apache-2.0) brings many packages along, so tests read what it found from
`test/dynamics/reference/geared_rotor.json`. With ROSS in an environment (`pip install ross-rotordynamics`):

    python benchmarks/against_ross.py            # ROSS anew, against the file and against this code
    python benchmarks/against_ross.py --write    # and into the file
    python benchmarks/against_ross.py --pair     # the gear pair with backlash, a minute
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import ross as rs
import scipy.linalg

sys.path.insert(0, str(Path(__file__).parents[1] / "test" / "dynamics"))

from geared_rotor import REFERENCE, described, our_frequencies


def ross_frequencies(data: dict) -> np.ndarray:
    """Natural frequencies (Hz) of all unknowns at standstill, ascending."""
    steel, mesh = data["steel"], data["mesh"]
    material = rs.Material(
        name="steel", rho=steel["density"], E=steel["elasticity"], G_s=steel["shear_modulus"], color="#525252"
    )
    rotors = [_rotor(rotor, material, mesh) for rotor in data["rotors"]]
    whole = rs.MultiRotor(
        *rotors,
        coupled_nodes=tuple(rotor["gear"]["node"] for rotor in data["rotors"]),
        gear_mesh_stiffness=mesh["stiffness"],
        orientation_angle=mesh["direction_rad"],
    )
    squares = scipy.linalg.eigvals(whole.K(0.0), whole.M())
    return np.sort(np.sqrt(np.abs(squares))) / (2.0 * np.pi)


def _rotor(rotor: dict, material: rs.Material, mesh: dict) -> rs.Rotor:
    spans = zip(rotor["lengths"], rotor["inner_diameters"], rotor["outer_diameters"], strict=True)
    shafts = [rs.ShaftElement(L=length, idl=inner, odl=outer, material=material) for length, inner, outer in spans]
    disks = [
        rs.DiskElement(n=body["node"], m=body["mass"], Id=body["diametral"], Ip=body["polar"])
        for body in rotor["bodies"]
    ]
    gear = rotor["gear"]
    wheel = rs.GearElement(
        n=gear["node"],
        m=gear["mass"],
        Id=gear["diametral"],
        Ip=gear["polar"],
        n_teeth=gear["teeth"],
        pitch_diameter=mesh["module"] * gear["teeth"],
        pr_angle=np.radians(mesh["pressure_angle_deg"]),
    )
    bearings = [
        rs.BearingElement(
            n=bearing["node"], kxx=bearing["across"][0], kyy=bearing["across"][1], kzz=bearing["axial"], cxx=0.0
        )
        for bearing in rotor["bearings"]
    ]
    return rs.Rotor(shafts, [*disks, wheel], bearings)


def ross_backlash_pair() -> dict[str, float]:
    """Force of the pair of ROSS's test `test_mesh_with_backlash` over its last three turns: mean, lines, N."""
    steel = rs.Material(name="steel", rho=7850.0, E=200e9, Poisson=0.3)
    light = rs.Material(name="light", rho=0.01, E=1e15, Poisson=0.3)
    width, mass, turn = 0.03, 6.57, 0.06
    rotors = [
        rs.Rotor(
            [rs.ShaftElement(n=0, L=1e-4, idl=0.0, odl=1e-4, material=light)],
            [
                rs.GearElementTVMS(
                    n=0,
                    material=steel,
                    width=width,
                    bore_diameter=np.sqrt(0.2**2 - 4.0 * mass / (np.pi * width * 7850.0)),
                    module=0.01,
                    n_teeth=20,
                    pr_angle=np.radians(20.0),
                    helix_angle=0,
                )
            ],
            [rs.BearingElement(n=0, kxx=1e8, kyy=1e8, cxx=512.64, cyy=512.64)],
        )
        for _ in range(2)
    ]
    pair = rs.MultiRotor(
        *rotors,
        coupled_nodes=(0, 0),
        square_varying_stiffness={"enable": True, "amplitude_ratio": 0.275},
        backlash={"enable": True, "initial_value": 5e-5, "error_amp": 2e-5, "smooth_operator": False, "sigma": 1e5},
    )
    speed, steps = 2.0 * np.pi / turn, 6000
    time = np.arange(5 * steps) * turn / steps
    loads = np.zeros((len(time), pair.ndof))
    for gear in (0, 2):
        loads[:, gear * pair.number_dof + 5] = 300.0 + 100.0 * np.sin(speed * time)
    run = pair.run_time_response(speed=speed, t=time, F=loads, method="newmark", newmark_type="robust")
    force = np.array(run.mesh_dynamics["mesh_force"])[2 * steps :]
    lines = 2.0 * np.abs(np.fft.rfft(force)) / len(force)
    return {"mean": float(force.mean()), "16.7 Hz": float(lines[3]), "333.3 Hz": float(lines[60])}


def main() -> None:
    """Compare, and write or run the pair if asked to."""
    data = described()
    found, ours = ross_frequencies(data), our_frequencies(data)
    for name, values in (("the file", np.array(data.get("frequencies_hz", found))), ("this code", ours)):
        # The first is the free rotation.
        print(f"{name}: {len(found) - 1} frequencies, largest difference {np.abs(values / found - 1.0)[1:].max():.1e}")
    if "--write" in sys.argv:
        data |= {"ross_version": rs.__version__, "frequencies_hz": [0.0, *np.round(found[1:], 9).tolist()]}
        REFERENCE.write_text(json.dumps(data, indent=2) + "\n", "utf-8")
    if "--pair" in sys.argv:
        print(ross_backlash_pair())


if __name__ == "__main__":
    main()
