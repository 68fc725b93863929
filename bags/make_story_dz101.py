"""Make `bags/story_dz101`, with another rock and then a changed machine: `python bags/make_story_dz101.py`.

The machine of the file bores through two parts of half a minute, felt by the accelerometers of `field_dz101`, unscaled:

1. in rock that shakes the head more than the machine file has it: the factors of the loads are those of `ROCK`;
2. in the same rock, with air in the oil of the hydraulic cylinders, which are softer by it: `WORN`.

Each part is a run of its own with loads of its own; one goes over into the next within half a second. What should be
said of it: of the first part rock, of the second the machine, x25, at 0.6.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from synthetic import MODEL_RATE_HZ, write_recording

from tbm_dynamics import Machine, load_machine, simulate

FOLDER = Path(__file__).parent / "story_dz101"
PART_S = 30.0
START_S = 2.0
"""Of every run, left out while its start dies away."""
BLEND_S = 0.5
SEED = 1907
ROCK = {"loads.axial_low": 1.5, "loads.axial_high": 1.3, "loads.lateral": 1.6, "loads.moments": 1.6}
WORN = {"x25": 0.6}
PARTS: tuple[dict[str, float], ...] = (ROCK, {**ROCK, **WORN})


def accelerations(machine: Machine, part_s: float = PART_S) -> dict[str, np.ndarray]:
    """Accelerations of all parts at the test points, each (n, 3) m/s²."""
    runs = [_run(machine.with_inputs(**changes), SEED + number, part_s) for number, changes in enumerate(PARTS)]
    return {point: _joined([run[point] for run in runs]) for point in machine.description.test_points}


def _run(machine: Machine, seed: int, part_s: float) -> dict[str, np.ndarray]:
    points = machine.description.test_points
    response = simulate(machine, START_S + part_s + BLEND_S, seed, outputs=points.values())
    first = round(START_S * MODEL_RATE_HZ)
    return {point: response.acceleration(place)[first:, :3].copy() for point, place in points.items()}


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    """Join runs that overlap; independent ones keep their mean square where squares of the weights add up to one."""
    count = round(BLEND_S * MODEL_RATE_HZ)
    angle = 0.5 * np.pi * (np.arange(count) + 0.5)[:, None] / count
    found = parts[0]
    for part in parts[1:]:
        blend = np.cos(angle) * found[-count:] + np.sin(angle) * part[:count]
        found = np.concatenate([found[:-count], blend, part[count:]])
    return found[:-count]


def main() -> None:
    """Write the recording, replacing the one that is there but for its notes."""
    machine = load_machine("dz101")
    write_recording(FOLDER, machine, accelerations(machine), SEED)


if __name__ == "__main__":
    main()
