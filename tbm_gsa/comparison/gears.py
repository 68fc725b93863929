"""What turns and meshes in the drives of a machine, and how fast: meshes with the gears in them, and shafts."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from tbm_dynamics import Machine


@dataclass(frozen=True)
class GearMesh:
    """Teeth that mesh at a rate, and the teeth of their gears by name."""

    name: str
    frequency_hz: float
    gears: Mapping[str, int]

    def sidebands(self, apart_hz: float) -> dict[str, float]:
        """Distance of the sidebands (Hz) from the mesh frequency that are farther than `apart_hz` from it, by gear.

        Each tooth of a gear meshes once in as many cycles as it has teeth: what is uneven about the gear modulates the
        mesh at its turns relative to the carrier (P. D. McFadden, J. D. Smith, Proc. IMechE C 199 (1985) 65–70).
        """
        found = {gear: self.frequency_hz / teeth for gear, teeth in self.gears.items()}
        return {gear: distance for gear, distance in found.items() if distance > apart_hz}


def gear_meshes(machine: Machine) -> Iterator[GearMesh]:
    """Mesh of pinion and ring, and of the stages of the gearbox from the pinion to the motor."""
    drive, mesh = machine.description.driveshaft, machine.mesh_frequency
    yield GearMesh("mesh frequency", mesh, {"pinion": drive.gear.pinion_teeth, "ring": drive.gear.ring_teeth})
    carrier = mesh / drive.gear.pinion_teeth
    for number, stage in enumerate(drive.gearbox.stages, start=1):
        gears = {"sun": stage.sun_teeth, "planet": stage.planet_teeth, "ring": stage.ring_teeth}
        yield GearMesh(f"stage {number} mesh frequency", carrier * stage.ring_teeth, gears)
        carrier *= stage.ratio


def shaft_speeds(machine: Machine) -> dict[str, float]:
    """Speeds of head, pinion, the suns of inner stages and the motor by name, turns a second."""
    drive, mesh = machine.description.driveshaft, machine.mesh_frequency
    speed = mesh / drive.gear.pinion_teeth
    found = {"cutterhead": mesh / drive.gear.ring_teeth, "pinion shaft": speed}
    for number, stage in enumerate(drive.gearbox.stages, start=1):
        speed *= stage.ratio
        found["motor shaft" if number == len(drive.gearbox.stages) else f"stage {number} sun shaft"] = speed
    return found
