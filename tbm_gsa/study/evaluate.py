"""The simulation of one sample: the machine with its inputs changed, run on the loads all samples share."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from tbm_dynamics import Machine, load_machine, simulate


@dataclass(frozen=True)
class MachineEvaluation:
    """The eight indicators of the paper's Table 3 as a function of the inputs.

    Parameters
    ----------
    machine : str
        Name of a shipped machine or path of a machine file.
    duration : float
        Simulated time, s.
    seed : int
        Seed of the loads. It is the same for every sample (common random numbers): with other loads for each, no
        surrogate could follow the peaks.
    """

    machine: str
    duration: float
    seed: int

    def __call__(self, sample: dict[str, float]) -> Mapping[str, float]:
        """Simulate one sample."""
        variant = _machine(self.machine).with_inputs(**sample)
        indicators: Mapping[str, float] = simulate(variant, duration=self.duration, seed=self.seed).indicators()
        return indicators

    @property
    def settings(self) -> dict[str, str | float | int]:
        """What the results depend on besides the inputs; the content of the machine file, not only its name."""
        content = _machine(self.machine).description.model_dump_json()
        return {
            "machine": self.machine,
            "machine_sha256": hashlib.sha256(content.encode()).hexdigest(),
            "duration": self.duration,
            "load_seed": self.seed,
        }

    @classmethod
    def from_settings(cls, settings: Mapping[str, str | float | int]) -> "MachineEvaluation":
        """Inverse of `settings`, for resuming a store."""
        return cls(str(settings["machine"]), float(settings["duration"]), int(settings["load_seed"]))


@lru_cache(maxsize=4)
def _machine(name: str) -> Machine:
    """Read the machine once per process."""
    return load_machine(name)
