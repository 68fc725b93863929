"""What to expect in the spectrum of a machine: lines of the loads, mesh frequency, axial natural frequencies."""

from collections.abc import Iterator, Mapping

import numpy as np

from tbm_dynamics import Machine
from tbm_gsa.comparison.results import ExpectedLine, LineKind
from tbm_gsa.signals.conditioning import LOW_PASS_LIMIT_HZ

MOSTLY = 0.5  # share of a mode's kinetic energy along x that makes it an axial one
AUDIBLE = 1e-3  # response of a point to the loads, relative to the strongest mode's, below which a mode is left out


def expected_lines(machine: Machine) -> tuple[ExpectedLine, ...]:
    """Lines of a machine at its operating point, each frequency once, the loads' first."""
    loads = {line.frequency for component in machine.description.loads.components for line in component.lines}
    mesh = machine.mesh_frequency
    return (
        *(_line(f"load line {frequency:g} Hz", frequency, "load") for frequency in sorted(loads)),
        _line("mesh frequency", mesh, "mesh"),
        _line("2 × mesh frequency", 2.0 * mesh, "mesh"),
        *_axial_lines(machine),
    )


def lines_of_levels(machines: Mapping[int, Machine]) -> tuple[ExpectedLine, ...]:
    """Lines of a machine at several levels of operation: what moves with the level is named after it, from 1."""
    first, *others = machines
    lines = list(expected_lines(machines[first]))
    for level in others:
        known = {round(line.frequency_hz, 3) for line in lines}
        moved = [line for line in expected_lines(machines[level]) if round(line.frequency_hz, 3) not in known]
        lines += [_line(f"{line.name}, level {level + 1}", line.frequency_hz, line.kind) for line in moved]
    return tuple(lines)


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
    chosen = (share > MOSTLY) & (response > AUDIBLE * response.max()) & (frequency < LOW_PASS_LIMIT_HZ)
    for number, value in enumerate(frequency[chosen].tolist(), start=1):
        yield _line(f"axial natural frequency A{number}", value, "axial")


def _line(name: str, frequency_hz: float, kind: LineKind) -> ExpectedLine:
    return ExpectedLine(name=name, frequency_hz=frequency_hz, kind=kind)
