"""How long the start of a run is felt: until the free motion that it leaves has died away."""

from __future__ import annotations

import math

import numpy as np

from tbm_dynamics.integration.basis import split_basis
from tbm_dynamics.structure.system import System

LOWEST_HZ = 0.5
"""Slower motion counts in no statistic of accelerations, and loads do not fluctuate below it."""
LEFT = 0.05
"""What is left of the free motion, of its amplitude, where it counts as died away."""
LONGEST_S = 0.5
"""A motion that takes longer is slow, or hardly excited: loads come in on a ramp, teeth move from the start."""


def settling_time(system: System) -> float:
    """Time (s) from the start of a run after which its statistics are those of the machine.

    Until the slowest damped vibration of the machine has lost 95 % of its amplitude, `LONGEST_S` at most: a run starts
    at rest under the mean load, and what it has to gain or to lose to be as it will be is a free motion.
    """
    basis = split_basis(system)
    poles = np.concatenate([part.eigenbasis.values.ravel() for part in (*basis.symmetric, basis.individual)])
    rates = -poles.real[poles.imag > 2.0 * math.pi * LOWEST_HZ]
    slowest = float(rates.min(initial=np.inf))
    return min(LONGEST_S, -math.log(LEFT) / slowest) if slowest > 0.0 else LONGEST_S
