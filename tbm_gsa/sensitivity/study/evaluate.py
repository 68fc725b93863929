"""The simulation of one sample: the machine with its inputs changed, run under a realisation of the loads."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Self

import numpy as np

from tbm_dynamics import Machine, load_machine, simulate
from tbm_dynamics.indicators import EXPECTED_PEAKS, INDICATORS
from tbm_dynamics.integration import DEFAULT_STEP
from tbm_dynamics.machine.description import MachineDescription
from tbm_dynamics.machine.sensor_place import SensorPlace
from tbm_gsa.provenance import machine_sha256
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.machine_inputs import check_ends
from tbm_gsa.sensitivity.study.outputs import Vibration, checked_outputs, expanded_outputs, parse_outputs
from tbm_msgs_py.base.texts import quoted

LOWEST_HIGH_HZ = 1.0
LONGEST_S = 3600.0  # of a simulation that is stored


@dataclass(frozen=True)
class MachineEvaluation:
    """Outputs of a run as a function of the inputs.

    It holds the machine itself, not the name of a file: processes on other computers need not have it.

    Parameters
    ----------
    machine : str
        Name of a shipped machine or path of a machine file, for messages.
    description : str
        The machine, as JSON.
    duration : float
        Simulated time, s.
    seed : int
        Of the loads: of the one realisation that all samples share, or of those that they share out.
    outputs : tuple of str
        See `parse_outputs`.
    high_hz : float or None
        Upper limit of the band of accelerations, see `vibration_statistics`.
    time_step : float
        Of every run, s: one for all, or the outputs would jump where a mesh gets stiffer.
    settling : float
        Time before each run that is left out, s; for the same reason one for all.
    """

    machine: str
    description: str
    duration: float
    seed: int
    outputs: tuple[str, ...] = INDICATORS
    high_hz: float | None = None
    time_step: float = DEFAULT_STEP
    settling: float = 0.0

    def __post_init__(self) -> None:
        if self.high_hz is not None and not LOWEST_HIGH_HZ <= self.high_hz < 0.5 / self.time_step:
            allowed = f"{LOWEST_HIGH_HZ:g} to below {0.5 / self.time_step:g} Hz"
            raise StudyError(f"upper limit of the band {self.high_hz:g} Hz, allowed: {allowed}")
        checked_outputs(self.outputs, self._points, self.duration, self.high_hz)

    @classmethod
    def of(
        cls,
        machine: str,
        duration: float,
        seed: int,
        outputs: tuple[str, ...] = INDICATORS,
        high_hz: float | None = None,
        time_step: float = DEFAULT_STEP,
        settling: float = 0.0,
    ) -> Self:
        """Load the machine; parameters as those of the class, whole spectra among the outputs by their bands."""
        loaded = load_machine(machine)
        text = loaded.description.model_dump_json()
        checked = cls(loaded.origin, text, duration, seed, outputs, high_hz, time_step, settling)
        return replace(checked, outputs=expanded_outputs(outputs, high_hz))

    def __call__(self, sample: dict[str, float], realisation: int | None = None) -> Mapping[str, float]:
        """Simulate one sample, under the common realisation of the loads or one that is numbered."""
        response = simulate(
            self._machine.with_inputs(**sample),
            duration=self.duration,
            seed=self.seed if realisation is None else _seed_of(self.seed, realisation),
            time_step=self.time_step,
            settling=self.settling,
            outputs=self._motion,
        )
        found = response.indicators()
        if not set(self.outputs).isdisjoint(EXPECTED_PEAKS):
            found |= response.expected_peaks()
        if self._vibrations:
            # Its filters take longer to load than a run takes: only workers that need them do.
            from tbm_gsa.sensitivity.study.vibration import vibration_statistics  # noqa: PLC0415

            found |= vibration_statistics(response, self._vibrations, self._points, self.high_hz)
        return {name: found[name] for name in self.outputs}

    def check(self, ends: Mapping[str, tuple[float, float]]) -> None:
        """Raise a StudyError where the machine does not allow the lower or upper bound of an input."""
        check_ends(self._machine, ends)

    @property
    def settings(self) -> dict[str, str | float | int]:
        """What the results depend on besides the inputs; the content of the machine file, not only its name.

        The operating point is the machine's, in effect where none of the inputs x1, x2, x3 changes it.
        """
        point = self._machine.description.operating_point
        return {
            "machine": self.machine,
            "machine_sha256": machine_sha256(self._machine),
            "speed_r_min": point.speed_r_min,
            "torque_kn_m": point.torque_kn_m,
            "thrust_kn": point.thrust_kn,
            "duration": self.duration,
            "load_seed": self.seed,
            **({} if self.high_hz is None else {"high_hz": self.high_hz}),
            **({} if self.time_step == DEFAULT_STEP else {"time_step": self.time_step}),
            **({} if self.settling == 0.0 else {"settling": self.settling}),
        }

    @classmethod
    def from_settings(cls, settings: Mapping[str, str | float | int], outputs: tuple[str, ...]) -> Self:
        """Inverse of `settings`, for going on with a store.

        Raises
        ------
        StudyError
            The machine file says something else now.
        """
        machine, duration, seed = (settings.get(name) for name in ("machine", "duration", "load_seed"))
        high_hz, time_step = settings.get("high_hz"), settings.get("time_step", DEFAULT_STEP)
        settling = settings.get("settling", 0.0)  # a study of before there was any goes on without
        if not (
            isinstance(machine, str)
            and isinstance(duration, float | int)
            and 0.0 < duration <= LONGEST_S
            and isinstance(seed, int)
            and seed >= 0
            and isinstance(high_hz, float | int | None)
            and isinstance(time_step, float)
            and 0.0 < time_step <= duration
            and isinstance(settling, float)
            and 0.0 <= settling <= LONGEST_S
        ):
            raise StudyError(f"settings {quoted(dict(settings))}, allowed: those of a simulation that `gsa run` stores")
        highest = None if high_hz is None else float(high_hz)
        evaluation = cls.of(machine, float(duration), seed, outputs, highest, time_step, settling)
        if evaluation.settings["machine_sha256"] != settings.get("machine_sha256"):
            raise StudyError(
                f"machine {evaluation.machine} has changed since the study was begun, allowed: the file as it was"
            )
        return evaluation

    @cached_property
    def _vibrations(self) -> tuple[Vibration, ...]:
        return parse_outputs(self.outputs, self._points)

    @cached_property
    def _points(self) -> Mapping[str, int | SensorPlace]:
        """Test points of the machine."""
        return self._machine.description.test_points

    @cached_property
    def _motion(self) -> tuple[int | SensorPlace, ...]:
        """Nodes and places whose motion the outputs need; the indicators need the ring gear and the first pinion."""
        drive = self._machine.description.driveshaft
        return (drive.ring_node, drive.pinion_nodes_from + 1, *(self._points[v.point] for v in self._vibrations))

    @property
    def _machine(self) -> Machine:
        return _machine(self.description, self.machine)


def _seed_of(seed: int, realisation: int) -> int:
    """Seed of a numbered realisation; those of studies with neighbouring seeds have nothing in common."""
    return int(np.random.SeedSequence([seed, realisation]).generate_state(1)[0] >> 1)


@lru_cache(maxsize=4)
def _machine(description: str, origin: str) -> Machine:
    """Read the machine once per process."""
    return Machine(MachineDescription.model_validate_json(description), origin=origin)
