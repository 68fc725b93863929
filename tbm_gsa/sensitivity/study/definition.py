"""The file in which a user defines a study: inputs with their distributions, groups, outputs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from tbm_dynamics import Machine
from tbm_dynamics.indicators import INDICATORS
from tbm_gsa.sensitivity.study.distributions import distribution_from, number
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.inputs import Input, InputSet, known_input
from tbm_gsa.sensitivity.study.machine_inputs import check_ends, default_inputs, machine_input
from tbm_gsa.sensitivity.study.outputs import checked_outputs
from tbm_msgs_py.base.strict_yaml import read_yaml
from tbm_msgs_py.base.texts import LONGEST_NAME, quoted

KEYS: Final = ("inputs", "groups", "outputs")


@dataclass(frozen=True)
class Definition:
    """What a study is about.

    Parameters
    ----------
    inputs : InputSet
    outputs : tuple of str
        Names of outputs; empty where the file names none.
    """

    inputs: InputSet
    outputs: tuple[str, ...] = ()


def study_definition(
    machine: Machine, path: str | Path | None, outputs: Sequence[str], duration: float, high_hz: float | None = None
) -> Definition:
    """Define a study of a machine by a file, or by its `default_inputs`, and check it as far as no run is needed.

    Parameters
    ----------
    machine : Machine
    path : str or Path or None
    outputs : sequence of str
        In place of the file's; the eight indicators where neither names any.
    duration : float
        Of a simulation, s.
    high_hz : float or None
        Upper limit of the band of accelerations, by default a comparison's.

    Raises
    ------
    StudyError
        What `read_definition` refuses, a range or an output that the machine does not have.
    """
    found = Definition(default_inputs(machine)) if path is None else read_definition(path, machine)
    check_ends(machine, found.inputs.ends)
    names = tuple(outputs) or found.outputs or INDICATORS
    checked_outputs(names, machine.description.test_points, duration, high_hz)
    return replace(found, outputs=names)


def read_definition(path: str | Path, machine: Machine | None = None) -> Definition:
    """Read a definition.

    The file maps codes of inputs to distributions; everything else about an input is known by its code, and one with
    nothing behind it is that of `default_inputs` or, of a factor of the loads, `LOAD_PRIOR`. An initial value that is
    not given is the machine's (the paper's of ``dz101``, 1 of a factor) if it lies inside the range, else the median::

        inputs:
          x2:
          x7: {lower: 200, upper: 400}
          x9: {distribution: normal, mean: 8.1e9, std: 2e8, lower: 7.5e9, upper: 8.5e9}
          x11: {distribution: log-uniform, lower: 2e-4, upper: 5e-3}
          x16: {distribution: triangular, lower: 0.5, mode: 1, upper: 2, initial: 1}
          loads.axial_low: {distribution: log-normal, lower: 0.25, upper: 4, median: 1, log_sigma: 0.7}
          drive_3.backlash: {lower: 100, upper: 500}
        groups:
          meshing: [x7, x9]
        outputs: [MF_M, rms_cutterhead_x]

    Parameters
    ----------
    path : str or Path
    machine : Machine, optional
        That is studied; the paper's without it.

    Raises
    ------
    StudyError
        One line that names the file, the input or group, and what is allowed.
    """
    document = read_yaml(path, "a study definition", KEYS, StudyError)
    try:
        return _definition(document, known_input if machine is None else partial(machine_input, machine))
    except StudyError as error:
        raise StudyError(f"{path}: {error}") from None


def _definition(document: dict[str, object], known: Callable[[str], Input]) -> Definition:
    """Build the definition of a parsed file."""
    stated = document.get("inputs")
    if not isinstance(stated, dict):  # nothing of it is quoted
        raise StudyError("inputs: missing or no mapping, allowed: codes of inputs with their distributions")
    for key in document:
        if key not in KEYS:
            raise StudyError(f"unknown key {quoted(key)}, allowed: {', '.join(KEYS)}")
    inputs = tuple(_input(known(str(code)), given) for code, given in stated.items())
    groups = document.get("groups") or {}
    if not isinstance(groups, dict):
        raise StudyError(f"groups: {quoted(groups)}, allowed: a mapping of names to lists of inputs")
    named = {_name(name): _names(f"group {name}", members) for name, members in groups.items()}
    if document.get("outputs") == []:
        raise StudyError("outputs: none, allowed: at least one, or no such key")
    return Definition(InputSet(inputs, named), _names("outputs", document.get("outputs") or []))


def _input(known: Input, given: object) -> Input:
    """Return a known input, with another distribution where one is given."""
    if given is None:
        return known
    try:
        if not isinstance(given, dict):
            raise StudyError(f"{quoted(given)}, allowed: a mapping such as {{lower: 1, upper: 2}}")
        law = distribution_from({key: value for key, value in given.items() if key != "initial"})
        if "initial" in given:
            initial = number("initial", given["initial"])
        else:
            initial = known.initial if law.lower <= known.initial <= law.upper else float(law.from_unit(0.5))
    except StudyError as error:
        raise StudyError(f"input {known.code}: {error}") from None
    return replace(known, initial=initial, distribution=law)


def _names(where: str, given: object) -> tuple[str, ...]:
    """Return a list of names; raise a StudyError for anything else."""
    if not isinstance(given, list) or not all(isinstance(name, str) for name in given):
        raise StudyError(f"{where}: {quoted(given)}, allowed: a list of names")
    return tuple(map(_name, given))


def _name(given: object) -> str:
    """Return a name of bounded length."""
    if len(name := str(given)) > LONGEST_NAME:
        raise StudyError(f"name {quoted(name)}, allowed: up to {LONGEST_NAME} characters")
    return name
