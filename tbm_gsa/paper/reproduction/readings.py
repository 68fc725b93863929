"""The two readings of Table 4's damping ratios, each a machine; nothing else differs between them."""

from dataclasses import dataclass, replace

from tbm_dynamics import Machine
from tbm_dynamics.machine.description import DampingReading
from tbm_dynamics.machine.summary import count_sources
from tbm_gsa.paper.reproduction import verdict
from tbm_gsa.paper.reproduction.result import Row, Value
from tbm_gsa.paper.reproduction.verdict import RowVerdict

RATIO_HZ = 100.0
"""Where a ratio is meant to hold: the paper says nothing; its lines and natural frequencies lie around here."""
_OTHER = {
    "stiffness_proportional": DampingReading(reading="ratio", frequency=RATIO_HZ),
    "ratio": DampingReading(reading="stiffness_proportional"),
}


@dataclass(frozen=True)
class Reading:
    """A machine under one reading.

    Attributes
    ----------
    name : str
        ``stiffness_proportional`` or ``ratio``.
    title : str
        In words.
    machine : Machine
    own : bool
        Whether it is the reading of the machine's file.
    fitted : bool
        Whether the machine was calibrated under it.
    """

    name: str
    title: str
    machine: Machine
    own: bool
    fitted: bool

    def row(
        self, stem: str, what: str, paper: Value, ours: Value, judged: RowVerdict, note: str = "", unit: str = ""
    ) -> Row:
        """Row under this reading."""
        return Row(stem if self.own else f"{stem}@{self.name}", what, paper, ours, judged, note, unit, self.name)

    def unless_fitted(self, judged: RowVerdict) -> RowVerdict:
        """Verdict of a number that the machine was fitted to under its own reading: no finding there."""
        return verdict.fitted(judged, self.fitted)


def readings(machine: Machine) -> tuple[Reading, Reading]:
    """Both readings of a machine, its own first."""
    chosen = machine.description.damping
    calibrated = count_sources(machine.description).get("calibrated", 0) > 0
    changed = machine.base.model_copy(update={"damping": _OTHER[chosen.reading]})
    other = replace(machine, base=changed, inputs=machine.inputs)
    return (
        Reading(chosen.reading, _title(chosen), machine, own=True, fitted=calibrated),
        Reading(changed.damping.reading, _title(changed.damping), other, own=False, fitted=False),
    )


def _title(damping: DampingReading) -> str:
    if damping.frequency is not None:
        return f"a true ratio at {damping.frequency:g} Hz"
    return "stiffness-proportional, C = ζ K with ζ in s"
