"""Calibrate a copy of `dz101`: `python -m tbm_dynamics.calibration --out dz101.yaml`.

Differential evolution over `free_values.FREE_VALUES` and a simplex from its best, a fixed seed, some ten minutes on one
core. The result goes to a new file, to be put in the place of the shipped one where it is accepted.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import Bounds, differential_evolution, minimize

from tbm_dynamics import Machine, MachineError, load_machine
from tbm_dynamics.calibration.free_values import FREE_VALUES, values_of
from tbm_dynamics.calibration.objective import objective
from tbm_dynamics.calibration.prediction import predict
from tbm_dynamics.machine.description import MachineDescription
from tbm_dynamics.machine.inputs import set_values
from tbm_dynamics.machine.loading import machine_text
from tbm_dynamics.machine.writing import edited_text
from tbm_msgs_py.base.files import write_whole
from tbm_msgs_py.base.units import STANDARD_GRAVITY
from tbm_msgs_py.base.validation import validated


def main() -> None:
    """Run the calibration and print what it reached."""
    parser = argparse.ArgumentParser(description="Calibrate the assumed values of dz101.")
    parser.add_argument("--out", type=Path, required=True, help="machine file to write")
    parser.add_argument("--generations", type=int, default=120)
    parser.add_argument("--polish", type=int, default=1200, help="machines of the simplex that ends the search")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    data = load_machine("dz101").base.model_dump(mode="json")

    def distance(searched: np.ndarray) -> float:
        set_values(data, values_of(searched.tolist()))
        try:
            machine = Machine(validated(MachineDescription, data, "dz101", MachineError))
            return objective(predict(machine), _fluctuation(machine))
        except (MachineError, np.linalg.LinAlgError) as error:
            _print(f"one machine left out: {error}")
            return 1e3

    found = differential_evolution(
        distance,
        Bounds(*np.array([free.bounds for free in FREE_VALUES]).T),
        maxiter=given.generations,
        popsize=2,
        seed=given.seed,
        polish=False,
        callback=lambda best, convergence: _print(f"{distance(best):.4f}  ({convergence:.2f})"),
    )
    # Differential evolution finds the valley; down along it a simplex is quicker.
    limits = np.array([free.bounds for free in FREE_VALUES])
    fine = minimize(
        distance, found.x, method="Nelder-Mead", bounds=limits, options={"maxfev": given.polish, "adaptive": True}
    )
    text = edited_text(machine_text("dz101"), values_of(fine.x.tolist()), "calibrated")
    write_whole(given.out, text.encode())
    machine = load_machine(given.out)
    prediction = predict(machine)
    _print(f"objective {fine.fun:.4f} after {found.nfev + fine.nfev} machines")
    _print(f"F_x fluctuates by {_fluctuation(machine):.1%}; stress {prediction.stress_used:.0%} of the allowable")
    _print(f"axial level of the pinion: x4 {prediction.steel_share:.2f} beside x16")
    for point, rms in prediction.rms.items():
        _print(f"{point}: {', '.join(f'{value / STANDARD_GRAVITY:.3f}' for value in rms)} g")
    _print("axial natural frequencies (Hz): " + ", ".join(f"{value:.1f}" for value in prediction.axial_frequencies))


def _fluctuation(machine: Machine) -> float:
    thrust = machine.description.loads.fx
    return thrust.fluctuation_rms / abs(thrust.mean)


def _print(line: str) -> None:
    sys.stderr.write(line + "\n")


if __name__ == "__main__":
    main()
