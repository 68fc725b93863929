"""What `gsa run` and `gsa shard` have in common: the options that a study is planned from, and its plan."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Final

import typer

from tbm_dynamics import Machine, load_machine
from tbm_gsa.app.cli.output import OUTPUTS_HELP, notes, split_names
from tbm_gsa.sensitivity.study.definition import study_definition
from tbm_gsa.sensitivity.study.design import KINDS
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_gsa.sensitivity.study.machine_inputs import unvaried_inputs
from tbm_gsa.sensitivity.study.outputs import OF_THE_DRIVE
from tbm_gsa.sensitivity.study.problem import StudyProblem
from tbm_msgs_py.base.errors import InputError

_STIFFER: Final = re.compile(r"x9|x10|drive_[0-9]+\.tooth_stiffness")
"""Inputs that make a mesh stiffer."""
SAMPLES_OF_ONE: Final = 10
"""Training simulations that share a realisation of the loads: few, for many of them, yet enough to know its effect."""
FEWEST_REALISATIONS: Final = 2
MOST_SAMPLES: Final = 1_000_000
Samples = Annotated[int, typer.Option("--samples", min=10, max=MOST_SAMPLES, help="Training simulations.")]
TestSamples = Annotated[int, typer.Option("--test", min=2, max=MOST_SAMPLES, help="Test simulations.")]
Design = Annotated[str, typer.Option("--design", help=f"Training points: {', '.join(KINDS)}.")]
Duration = Annotated[float, typer.Option("--duration", min=0.01, max=3600.0, help="Length of a simulation (s).")]
Inputs = Annotated[
    Path | None,
    typer.Option(
        "--inputs",
        help="YAML file with inputs, distributions, groups, outputs; default: the paper's Table 4, of another machine "
        "than dz101 the same ranges as factors on its own values.",
    ),
]
Outputs = Annotated[
    str | None, typer.Option("--outputs", help=f"{OUTPUTS_HELP}those of --inputs, else the eight indicators.")
]
CommonLoads = Annotated[
    bool,
    typer.Option("--common-loads", help="One realisation of the loads for all simulations, as in the paper."),
]
HighHz = Annotated[
    float | None,
    typer.Option("--high-hz", help="Upper limit of the band of accelerations (Hz); default: 1000, as of a comparison."),
]


def planned_study(
    machine: str,
    duration: float,
    inputs: Path | None,
    outputs: str | None,
    high_hz: float | None,
    design: str,
    sizes: tuple[int, int],
    seed: int,
    time_step: float | None,
    common_loads: bool,
) -> tuple[StudyProblem, MachineEvaluation]:
    """Plan a study of `sizes` training and test simulations; all about it is checked, before a folder is made."""
    described = load_machine(machine)
    given = split_names("--outputs", [] if outputs is None else [outputs])
    definition = study_definition(described, inputs, given, duration, high_hz)
    if inputs is None and (still := unvaried_inputs(described)):
        notes.print(f"not varied, 0 in the machine file: {', '.join(still)}", highlight=False)
    step = _time_step(described, definition.inputs, time_step)
    settling = described.settling()
    evaluate = MachineEvaluation.of(machine, duration, seed, definition.outputs, high_hz, step, settling)
    if high_hz is not None and set(definition.outputs) <= set(OF_THE_DRIVE):
        raise InputError(f"--high-hz {high_hz:g}: no output is of an acceleration, allowed: with one")
    problem = StudyProblem(
        definition.inputs,
        evaluate.outputs,
        *sizes,
        seed,
        evaluate.settings,
        design,
        realisations=0 if common_loads else max(FEWEST_REALISATIONS, round(sizes[0] / SAMPLES_OF_ONE)),
    )
    return problem, evaluate


def _time_step(machine: Machine, inputs: InputSet, wanted: float | None) -> float:
    """Time step of all simulations, s: one that the stiffest mesh of the study allows, too."""
    stiffest = {code: high for code, (_, high) in inputs.ends.items() if _STIFFER.fullmatch(code)}
    machines = [machine, machine.with_inputs(**stiffest)]
    return min(one.step(wanted) for one in machines)
