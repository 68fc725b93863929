"""Table 1 and Figure 4: the loads of both models beside the paper's.

The spectral model is made of Table 1, so its numbers are given. The cutter model knows of Table 1 only the thrust, and
has a rock chosen for the torque: what else it gives is found.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from tbm_dynamics import Machine
from tbm_dynamics.loads.cutters.head import Cutterhead
from tbm_dynamics.loads.cutters.layout import TYPES
from tbm_gsa.paper.load_summary import LoadRun, load_run
from tbm_gsa.paper.loads import CUTTERS, HEAD_DIAMETER_M, TABLE_1, LoadRow
from tbm_gsa.paper.reproduction import verdict
from tbm_gsa.paper.reproduction.row import Row
from tbm_gsa.paper.reproduction.verdict import Verdict

SECONDS: Final = 600.0
# What of the cutter model is Table 1's: the thrust goes in, the rock is chosen for the torque.
_PUT_IN: Final[dict[str, Verdict]] = {"fx": "given", "mx": "calibrated"}


@dataclass(frozen=True, eq=False)
class LoadEvidence:
    """Runs of the loads.

    Attributes
    ----------
    spectral : LoadRun
    cutter : LoadRun or None
        None for a machine without cutters.
    head : Cutterhead or None
    """

    spectral: LoadRun
    cutter: LoadRun | None
    head: Cutterhead | None


def gather_loads(machine: Machine, seed: int, seconds: float = SECONDS) -> LoadEvidence:
    """Run the loads of a machine at its operating point."""
    head = machine.cutter_loads(seed).head if machine.description.cutters else None
    cutter = None if head is None else load_run(machine, "cutter", seconds, seed)
    return LoadEvidence(load_run(machine, "spectral", seconds, seed), cutter, head)


def load_rows(evidence: LoadEvidence) -> Iterator[Row]:
    """Rows of Table 1 and Figure 4."""
    for name, paper in TABLE_1.items():
        yield from _spectral(name, paper, evidence.spectral.document["components"][name])
    if evidence.cutter is not None:
        for name, paper in TABLE_1.items():
            yield from _cutter(name, paper, evidence.cutter.document["components"][name])
    yield from _head(evidence.head)


def _spectral(name: str, paper: LoadRow, found: dict[str, Any]) -> Iterator[Row]:
    ours, note = abs(found["mean"]), "spectral model, made of Table 1; signs are ours, amplitudes assumed"
    judged = verdict.echoed(verdict.level(paper.mean, ours) == "agrees")
    what = f"{paper.name}, mean"
    yield Row(f"table1.{name}.mean", "Table 1", what, paper.mean / 1e3, ours / 1e3, judged, note, _unit(name))
    yield _lines(f"table1.{name}.lines", "", paper, found, verdict.echoed(_all_found(paper, found)))


def _cutter(name: str, paper: LoadRow, found: dict[str, Any]) -> Iterator[Row]:
    ours = abs(found["mean"])
    judged = verdict.level(paper.mean, ours)
    if judged == "agrees":
        judged = _PUT_IN.get(name, judged)
    note = {
        "fx": "cutter model: the thrust is its input",
        "mx": "cutter model: the rock is chosen so that the thrust gives this torque",
    }.get(name, "cutter model: an even face has no standing side force or moment; a face of unequal rock has")
    what = f"{paper.name}, mean of the forces on the cutters"
    yield Row(f"table1.{name}.mean.cutters", "Table 1", what, paper.mean / 1e3, ours / 1e3, judged, note, _unit(name))
    judged = verdict.statement(_all_found(paper, found))
    yield _lines(f"table1.{name}.lines.cutters", " of the forces on the cutters", paper, found, judged)


def _all_found(paper: LoadRow, found: dict[str, Any]) -> bool:
    ours = (line["found_hz"] for line in found["lines"])
    return all(verdict.line(wanted, one) == "agrees" for wanted, one in zip(paper.lines, ours, strict=True))


def _lines(stem: str, of: str, paper: LoadRow, found: dict[str, Any], judged: Verdict) -> Row:
    wanted = ", ".join(f"{value:g}" for value in paper.lines)
    ours = ", ".join("–" if line["found_hz"] is None else f"{line['found_hz']:.2f}" for line in found["lines"])
    regions = " and ".join(f"{low:g}–{high:g}" for low, high in paper.regions)
    note = f"{found['in_regions']:.0%} of the fluctuation's power in Table 1's regions {regions} Hz"
    return Row(stem, "Table 1", f"{paper.name}, typical frequencies{of}", wanted, ours, judged, note, "Hz")


def _head(head: Cutterhead | None) -> Iterator[Row]:
    kinds = () if head is None else head.layout.kind
    ours: dict[str, int] = {kind: head.layout.count(kind) for kind in TYPES if head and kind in kinds}
    same = ours == CUTTERS
    yield Row("figure4.cutters", "Figure 4", "disc cutters", _counts(CUTTERS), _counts(ours), verdict.echoed(same))
    diameter = None if head is None else 2.0 * head.description.head_radius
    same = diameter is not None and verdict.close(HEAD_DIAMETER_M, diameter)
    yield Row(
        "figure4.diameter",
        "Figure 4",
        "diameter of the cutterhead",
        HEAD_DIAMETER_M,
        diameter,
        verdict.echoed(same),
        unit="m",
    )


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in counts.items()) or "none described"


def _unit(name: str) -> str:
    return "kN" if name.startswith("f") else "kN·m"
