"""What may have changed, and how far: the inputs of an explanation."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from tbm_dynamics import Machine
from tbm_dynamics.loads.description import LoadFactors
from tbm_dynamics.machine.inputs import input_values, multiplied_part
from tbm_gsa.sensitivity.study.distributions import LogUniform, Uniform
from tbm_gsa.sensitivity.study.inputs import Input, InputSet
from tbm_gsa.sensitivity.study.machine_inputs import default_inputs
from tbm_msgs_py.base.errors import InputError

OPERATING: Final = ("x1", "x2", "x3")
"""Known from the recording, or the machine's own: no explanation."""
FAULT: Final = 3.0
"""Factor by which a stiffness may be off, more than the uncertainty in Table 4."""
DECADE: Final = 10.0


def explaining_inputs(machine: Machine) -> InputSet:
    """Select the inputs of a study of the machine, but its operating point; each range reaches to its own value."""
    own = input_values(machine.description)
    items = [
        _around(item, own[item.code])
        for item in default_inputs(machine).inputs
        if item.code in own and item.code not in OPERATING
    ]
    return InputSet(tuple(items))


def loads_prior(machine: Machine) -> LoadFactors:
    """Factors of the loads as they are known beforehand: medians, all positive, and the scatter of their logarithms.

    Raises
    ------
    InputError
        One that is 0.
    """
    prior = machine.description.loads.factors
    if not prior.values.all():
        raise InputError(f"{machine.origin}: loads.factors: one is 0, allowed: positive ones, to be found again")
    return prior


def _around(item: Input, value: float) -> Input:
    """Widen a range to a fault's: stiffness may fall to a third; what spans decades is as likely in each."""
    if multiplied_part(item.code):
        return replace(item, initial=value, distribution=LogUniform(value / FAULT, value * FAULT))
    low, high = min(item.lower, value), max(item.upper, value)
    law = LogUniform(low, high) if high > DECADE * low else Uniform(low, high)
    return replace(item, initial=value, distribution=law)
