"""What to expect in the spectrum of a machine: lines of loads, gears and shafts, axial natural frequencies."""

from collections.abc import Iterator, Mapping

import numpy as np

from tbm_dynamics import Machine
from tbm_gsa.comparison.gears import gear_meshes, shaft_speeds
from tbm_gsa.comparison.results import ExpectedLine, LineKind
from tbm_gsa.signals.conditioning import HIGH_PASS_HZ, LOW_PASS_LIMIT_HZ
from tbm_gsa.signals.statistics import LINE_TOLERANCE_HZ

MOSTLY = 0.5  # share of a mode's kinetic energy along x that makes it an axial one
AUDIBLE = 1e-3  # response of a point to the loads, relative to the strongest mode's, below which a mode is left out


def expected_lines(machine: Machine, high_hz: float = LOW_PASS_LIMIT_HZ) -> tuple[ExpectedLine, ...]:
    """Lines of a machine at its operating point between 0.5 Hz and `high_hz`, the loads' first."""
    lines = (*_load_lines(machine), *_mesh_lines(machine), *_shaft_lines(machine), *_axial_lines(machine))
    return tuple(line for line in lines if HIGH_PASS_HZ < line.frequency_hz < high_hz)


def lines_of_levels(machines: Mapping[int, Machine], high_hz: float = LOW_PASS_LIMIT_HZ) -> tuple[ExpectedLine, ...]:
    """Lines of a machine at several levels of operation: what moves with the level is named after it, from 1."""
    first, *others = machines
    lines = list(expected_lines(machines[first], high_hz))
    for level in others:
        known = {round(line.frequency_hz, 3) for line in lines}
        moved = [line for line in expected_lines(machines[level], high_hz) if round(line.frequency_hz, 3) not in known]
        lines += [_line(f"{line.name}, level {level + 1}", line.frequency_hz, line.kind) for line in moved]
    return tuple(lines)


def _load_lines(machine: Machine) -> Iterator[ExpectedLine]:
    loads = {line.frequency for component in machine.driven_loads.components for line in component.lines}
    for frequency in sorted(loads):
        yield _line(f"load line {frequency:g} Hz", frequency, "load")


def _mesh_lines(machine: Machine) -> Iterator[ExpectedLine]:
    """Mesh frequencies, their doubles, and the sidebands of the gears that a spectrum tells from them."""
    for mesh in gear_meshes(machine):
        yield _line(mesh.name, mesh.frequency_hz, "mesh")
        yield _line(f"2 × {mesh.name}", 2.0 * mesh.frequency_hz, "mesh")
        for gear, distance in mesh.sidebands(LINE_TOLERANCE_HZ).items():
            yield _line(f"{mesh.name} − {gear}", mesh.frequency_hz - distance, "sideband")
            yield _line(f"{mesh.name} + {gear}", mesh.frequency_hz + distance, "sideband")


def _shaft_lines(machine: Machine) -> Iterator[ExpectedLine]:
    for name, speed in shaft_speeds(machine).items():
        yield _line(name, speed, "shaft")


def _axial_lines(machine: Machine) -> Iterator[ExpectedLine]:
    """Undamped axial modes that the loads excite and a test point feels, numbered A1, A2 … from the lowest."""
    system = machine.assemble()
    frequency, shapes = system.modes
    along = np.arange(0, system.size, 6)
    axial = shapes[along]
    share = np.einsum("ik,ij,jk->k", axial, system.M[np.ix_(along, along)], axial)
    loaded = shapes[system.dof(machine.description.load_node, "ux")]
    felt = [place.rows(system)[0] @ shapes for place in machine.description.sensor_places.values()]
    response = np.abs(loaded * np.array(felt)).max(axis=0, initial=0.0)
    chosen = (share > MOSTLY) & (response > AUDIBLE * response.max())
    for number, value in enumerate(frequency[chosen].tolist(), start=1):
        yield _line(f"axial natural frequency A{number}", value, "axial")


def _line(name: str, frequency_hz: float, kind: LineKind) -> ExpectedLine:
    return ExpectedLine(name=name, frequency_hz=frequency_hz, kind=kind)
