"""What the paper leaves open, tried one by one, for the main parameters and trends that differ.

    python -m tbm_gsa.paper.reproduction.alternatives --out DIR

Each alternative is a campaign of its own, Kriging and closed form; docs/reproduction.md says what came out.
"""

import argparse
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np

from tbm_dynamics import Machine, Response, load_machine, simulate
from tbm_dynamics.indicators import INDICATORS
from tbm_dynamics.machine.description import DampingReading, MachineDescription
from tbm_dynamics.structure.drive import gear_pair
from tbm_gsa.paper.published import MAIN, TRENDS
from tbm_gsa.paper.reproduction.readings import RATIO_HZ
from tbm_gsa.paper.reproduction.sensitivity import spearman
from tbm_gsa.paper.reproduction.verdict import MAIN_COUNT
from tbm_gsa.sensitivity.sobol.closed_form import sobol_closed_form
from tbm_gsa.sensitivity.study.campaign import run_campaign
from tbm_gsa.sensitivity.study.curves import response_curve
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS
from tbm_gsa.sensitivity.study.problem import Setting, StudyProblem
from tbm_gsa.sensitivity.study.store import Store
from tbm_gsa.sensitivity.surrogates import Surrogate, fit_surrogate

Change = Callable[[MachineDescription], MachineDescription]

WITHOUT_STATIC: Final = ("RDef_A", "RDef_L", "RDef_R")
WITH_GROSS_ROTATION: Final = ("MF_M", "MF_Se")
OUTPUTS: Final = (
    *INDICATORS,
    *(f"{name} without static part" for name in WITHOUT_STATIC),
    *(f"{name} with gross rotation" for name in WITH_GROSS_ROTATION),
    "MF_Se about its mean",
)
_AXES: Final = (0, 1, 3)
SAMPLES: Final = 200
SIMULATION_S: Final = 3.0


@dataclass(frozen=True)
class WiderEvaluation:
    """The eight indicators, and some of them read in another way.

    Parameters
    ----------
    description : str
        The machine, as JSON.
    seed : int
        Of the loads.
    """

    description: str
    seed: int

    def __call__(self, sample: dict[str, float]) -> Mapping[str, float]:
        """Simulate one sample."""
        machine = Machine(MachineDescription.model_validate_json(self.description)).with_inputs(**sample)
        response = simulate(machine, SIMULATION_S, self.seed, outputs=_nodes(machine))
        moving = response.displacement(response.ring_node)[:, _AXES].std(axis=0)
        found = dict(zip(OUTPUTS[len(INDICATORS) :], (*map(float, moving), *_turning(machine, response)), strict=True))
        return {**response.indicators(), **found}


def _nodes(machine: Machine) -> tuple[int, int]:
    drive = machine.description.driveshaft
    return drive.ring_node, drive.pinion_nodes_from + 1


def _turning(machine: Machine, response: Response) -> tuple[float, float, float]:
    """MF_M and MF_Se if the rock's damper took part in the whole rotation of the head, and MF_Se about the mean.

    The motors would have to hold the damper's moment ζ k Ω too, on top of the torque that F̄_s is made of: while the
    teeth stay in contact each mesh carries its share of it more.
    """
    description, drive = machine.description, machine.description.driveshaft
    (rock,) = (item for item in description.all_connections() if item.name == "k_r_ct")
    moment = description.connection_damping.rock * rock.stiffness[3] * machine.operating_point.speed
    force = response.mesh_force + moment / (drive.count * gear_pair(drive).driven_base_radius)
    deviation = np.sqrt(np.mean((force - response.static_mesh_force) ** 2, axis=0)).mean()
    return float(force.max()), float(deviation), float(response.mesh_force.std(axis=0).mean())


def _as_ratio(description: MachineDescription) -> MachineDescription:
    return description.model_copy(update={"damping": DampingReading(reading="ratio", frequency=RATIO_HZ)})


def _loads(name: str, factor: float, below_hz: float = np.inf) -> Change:
    """Scale the fluctuation of a component of the loads, all of it or the slow part."""

    def change(description: MachineDescription) -> MachineDescription:
        component = getattr(description.loads, name)
        regions = tuple(
            one.model_copy(update={"rms": factor * one.rms}) if one.band[1] < below_hz else one
            for one in component.regions
        )
        lines = tuple(
            one.model_copy(update={"amplitude": factor * one.amplitude}) if one.frequency < below_hz else one
            for one in component.lines
        )
        scaled = component.model_copy(update={"regions": regions, "lines": lines})
        return description.model_copy(update={"loads": description.loads.model_copy(update={name: scaled})})

    return change


def _grade(grade: int) -> Change:
    """Set the accuracy of the pinions: three grades more are an error 2.8 times as large."""

    def change(description: MachineDescription) -> MachineDescription:
        gear = description.driveshaft.gear.model_copy(update={"accuracy_grade": grade})
        return description.model_copy(update={"driveshaft": description.driveshaft.model_copy(update={"gear": gear})})

    return change


ALTERNATIVES: Final[dict[str, Change]] = {
    "as shipped": lambda description: description,
    "dampings as ratios at 100 Hz": _as_ratio,
    "torque fluctuates a tenth": _loads("mx", 0.1),
    "slow thrust fluctuates a tenth": _loads("fx", 0.1, below_hz=20.0),
    "mesh error of grade 9": _grade(9),
}


@dataclass(frozen=True)
class OutputShares:
    """Shares and trends of one output under an alternative.

    Attributes
    ----------
    r2 : float
        Of ten-fold cross validation.
    strongest, paper : dict of str to float
        First index by input, of the strongest and of those that the paper names.
    trends, change : dict of str to float
        Spearman's ρ and relative change over the range, by input that the paper shows.
    """

    r2: float
    strongest: dict[str, float]
    paper: dict[str, float]
    trends: dict[str, float]
    change: dict[str, float]


def try_alternative(name: str, folder: Path, seed: int = 0, workers: int = 2) -> dict[str, OutputShares]:
    """Run the campaign of an alternative; its shares and trends by output."""
    description = ALTERNATIVES[name](load_machine("dz101").description)
    evaluate = WiderEvaluation(description.model_dump_json(), seed)
    settings: dict[str, Setting] = {"alternative": name, "duration": SIMULATION_S, "load_seed": seed}
    problem = StudyProblem(PAPER_INPUTS, OUTPUTS, SAMPLES, 2, seed, settings)
    with Store.create_or_open(folder / f"{name.replace(' ', '_')}.sqlite", problem) as store:
        run_campaign(store, evaluate, workers=workers)
        X, Y = store.results("train")
    unit = PAPER_INPUTS.to_unit(X)
    bounds = np.tile([0.0, 1.0], (len(PAPER_INPUTS), 1))
    return {
        output: _shares(output, fit_surrogate("krg", unit, Y[:, column], bounds=bounds, seed=seed))
        for column, output in enumerate(OUTPUTS)
    }


def _shares(output: str, model: Surrogate) -> OutputShares:
    name = output.partition(" ")[0]
    first = dict(zip(PAPER_INPUTS.codes, sobol_closed_form(model).first.tolist(), strict=True))
    ranked = sorted(first, key=lambda code: -first[code])[:MAIN_COUNT]
    curves = {
        code: response_curve(model, PAPER_INPUTS, PAPER_INPUTS.codes.index(code)) for code in TRENDS.get(name, {})
    }
    return OutputShares(
        r2=model.cross_validate(10).r2,
        strongest={code: first[code] for code in ranked},
        paper={code: first[code] for code in MAIN.get(name, ())},
        trends={code: spearman(curve) for code, curve in curves.items()},
        change={code: float(curve.response[-1] / curve.response[0] - 1.0) for code, curve in curves.items()},
    )


def main() -> None:
    """Try every alternative and print one JSON document."""
    parser = argparse.ArgumentParser(prog="python -m tbm_gsa.paper.reproduction.alternatives", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the campaigns; those there are kept")
    folder = parser.parse_args().out
    found = {name: try_alternative(name, folder) for name in ALTERNATIVES}
    json.dump(found, sys.stdout, default=asdict, indent=1, ensure_ascii=False)


if __name__ == "__main__":
    main()
