"""Calibrate a copy of `dz101`: `python -m tbm_dynamics.calibration --out dz101.yaml`.

Differential evolution over `free_values.FREE_VALUES` and a simplex from its best, a fixed seed, some ten minutes on one
core. The result goes to a new
file; whoever accepts it puts it in the place of the shipped one.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from importlib import resources
from pathlib import Path

import numpy as np
from scipy.optimize import Bounds, differential_evolution, minimize

from tbm_dynamics.calibration.free_values import FREE_VALUES, with_values
from tbm_dynamics.calibration.objective import objective
from tbm_dynamics.calibration.prediction import predict
from tbm_dynamics.machine import Machine, MachineError, load_machine
from tbm_msgs_py.base.units import STANDARD_GRAVITY


def main() -> None:
    """Run the calibration and say what it reached."""
    parser = argparse.ArgumentParser(description="Calibrate the assumed values of dz101.")
    parser.add_argument("--out", type=Path, required=True, help="machine file to write")
    parser.add_argument("--generations", type=int, default=120)
    parser.add_argument("--polish", type=int, default=1200, help="machines of the simplex that ends the search")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    text = (resources.files("tbm_dynamics") / "machines" / "dz101.yaml").read_text("utf-8")
    with tempfile.TemporaryDirectory() as folder:
        trial = Path(folder) / "trial.yaml"

        def distance(searched: np.ndarray) -> float:
            try:
                machine = _written(text, searched, trial)
                return objective(predict(machine), *_fluctuations(machine))
            except (MachineError, np.linalg.LinAlgError) as error:
                _say(f"one machine left out: {error}")
                return 1e3

        found = differential_evolution(
            distance,
            Bounds(*np.array([free.bounds for free in FREE_VALUES]).T),
            maxiter=given.generations,
            popsize=2,
            seed=given.seed,
            polish=False,
            callback=lambda best, convergence: _say(f"{distance(best):.4f}  ({convergence:.2f})"),
        )
        # Differential evolution finds the valley; down along it a simplex is quicker.
        limits = np.array([free.bounds for free in FREE_VALUES])
        fine = minimize(
            distance, found.x, method="Nelder-Mead", bounds=limits, options={"maxfev": given.polish, "adaptive": True}
        )
        machine = _written(text, fine.x, given.out)
    prediction = predict(machine)
    thrust, torque = _fluctuations(machine)
    _say(f"objective {fine.fun:.4f} after {found.nfev + fine.nfev} machines")
    _say(f"F_x fluctuates by {thrust:.1%}, M_x by {torque:.1%}")
    for point, rms in prediction.rms.items():
        _say(f"{point}: {', '.join(f'{value / STANDARD_GRAVITY:.3f}' for value in rms)} g")
    heights = (f"{height / 1e3:.1f} kN at {frequency} Hz" for frequency, height in prediction.mesh_lines.items())
    _say("mesh-force lines: " + ", ".join(heights))
    _say("axial natural frequencies (Hz): " + ", ".join(f"{value:.1f}" for value in prediction.axial_frequencies))


def _written(text: str, searched: np.ndarray, path: Path) -> Machine:
    path.write_text(with_values(text, searched.tolist()), encoding="utf-8")
    return load_machine(path)


def _fluctuations(machine: Machine) -> tuple[float, float]:
    loads = machine.description.loads
    thrust, torque = (component.fluctuation_rms / abs(component.mean) for component in (loads.fx, loads.mx))
    return thrust, torque


def _say(line: str) -> None:
    sys.stderr.write(line + "\n")


if __name__ == "__main__":
    main()
