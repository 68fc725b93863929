"""Curves of a machine at one level of operation, computed in a process of its own and kept on disk."""

from __future__ import annotations

import sys
from typing import Self

from tbm_dynamics import Machine, load_machine
from tbm_gsa.explanation.band_reading import BandReading
from tbm_gsa.explanation.curve_cache import at_operating_point, cached_curves, kept_curves
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.fields import FrozenModel
from tbm_msgs_py.base.units import R_MIN


class CurveJob(FrozenModel):
    """What is to be computed.

    Attributes
    ----------
    machine : str
        Name or file.
    speed_r_min, torque_kn_m, thrust_kn : float
    reading : BandReading
    workers : int
    """

    machine: str
    speed_r_min: float
    torque_kn_m: float
    thrust_kn: float
    reading: BandReading
    workers: int = 1

    @classmethod
    def at(cls, machine: str, point: Array, reading: BandReading, workers: int) -> Self:
        """Job at a speed, torque and thrust (3,) in SI units."""
        speed, torque, thrust = (float(value) for value in point)
        return cls(
            machine=machine,
            speed_r_min=speed / R_MIN,
            torque_kn_m=torque / 1e3,
            thrust_kn=thrust / 1e3,
            reading=reading,
            workers=workers,
        )

    def variant(self, machine: Machine) -> Machine:
        """Machine at the level of operation."""
        return at_operating_point(machine, self.speed_r_min, self.torque_kn_m, self.thrust_kn)


def main() -> int:
    """Compute the curves of the job in the first argument, JSON; the last line of stderr is how far it is."""
    try:
        job = CurveJob.model_validate_json(sys.argv[1])
        machine = job.variant(load_machine(job.machine))
        cached_curves(machine, job.reading, job.workers, _say)
        if kept_curves(machine, job.reading) is None:
            raise InputError("the curves could not be kept, allowed: a cache folder that can be written")
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


def _say(done: int, of: int) -> None:
    sys.stderr.write(f"{done} of {of} machines\n")
    sys.stderr.flush()
