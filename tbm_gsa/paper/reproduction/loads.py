"""Table 1 and Figure 4: the loads of both models beside the paper's.

The spectral model is made of Table 1, so its numbers are given. The cutter model knows of Table 1 only the thrust, and
has a rock chosen for the torque: what else it gives is found.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from tbm_dynamics import Machine
from tbm_dynamics.loads.cutters.layout import TYPES
from tbm_gsa.paper.load_summary import ComponentSummary, LoadRun, load_run
from tbm_gsa.paper.published import CUTTERS, HEAD_DIAMETER_M, TABLE_1, LoadRow
from tbm_gsa.paper.reproduction import verdict
from tbm_gsa.paper.reproduction.result import Row
from tbm_gsa.paper.reproduction.verdict import RowVerdict

# What of the cutter model is Table 1's: the thrust goes in, the rock is chosen for the torque.
_PUT_IN: Final[dict[str, RowVerdict]] = {"fx": "given", "mx": "calibrated"}
_CUTTER_NOTES: Final = {
    "fx": "cutter level: the thrust is its input",
    "mx": "cutter level: the rock is chosen so that the thrust gives this torque",
}
_OTHER_NOTE: Final = "cutter level: an even face has no standing side force or moment; a face of unequal rock has"


@dataclass(frozen=True, eq=False)
class LoadEvidence:
    """Runs of the loads.

    Attributes
    ----------
    spectral : LoadRun
    cutter : LoadRun or None
        None for a machine without cutters.
    cutters : dict of str to int
        Number of disc cutters by type.
    head_diameter : float or None
        m; None for a machine without cutters.
    """

    spectral: LoadRun
    cutter: LoadRun | None
    cutters: Mapping[str, int]
    head_diameter: float | None


def gather_loads(machine: Machine, seed: int, seconds: float) -> LoadEvidence:
    """Run the loads of a machine at its operating point."""
    spectral, cutters = load_run(machine, "spectral", seconds, seed), machine.description.cutters
    if cutters is None:
        return LoadEvidence(spectral, None, {}, None)
    layout = machine.cutter_loads().head.layout
    counts: dict[str, int] = {kind: layout.count(kind) for kind in TYPES if kind in layout.kind}
    return LoadEvidence(spectral, load_run(machine, "cutter", seconds, seed), counts, 2.0 * cutters.head_radius)


def load_rows(evidence: LoadEvidence) -> Iterator[Row]:
    """Rows of Table 1 and Figure 4."""
    for name, paper in TABLE_1.items():
        yield from _given(name, paper, evidence.spectral.summary.components[name])
    if evidence.cutter is not None:
        for name, paper in TABLE_1.items():
            yield from _found(name, paper, evidence.cutter.summary.components[name])
    same = verdict.echoed(evidence.cutters == CUTTERS)
    yield Row("figure4.cutters", "disc cutters", _counts(CUTTERS), _counts(evidence.cutters), same)
    diameter = evidence.head_diameter
    same = verdict.echoed(diameter is not None and verdict.close(HEAD_DIAMETER_M, diameter))
    yield Row("figure4.diameter", "diameter of the cutterhead", HEAD_DIAMETER_M, diameter, same, unit="m")


def _given(name: str, paper: LoadRow, loads: ComponentSummary) -> Iterator[Row]:
    """Rows of a component of the spectral model."""
    judged = verdict.echoed(verdict.level(paper.mean, abs(loads.mean)) == "agrees")
    note = "spectral model, made of Table 1; signs are ours, amplitudes assumed"
    yield _mean(f"table1.{name}.mean", "", paper, loads, judged, note)
    yield _lines(f"table1.{name}.lines", "", paper, loads, verdict.echoed(_all_found(paper, loads)))


def _found(name: str, paper: LoadRow, loads: ComponentSummary) -> Iterator[Row]:
    """Rows of a component of the cutter level."""
    judged, of = verdict.level(paper.mean, abs(loads.mean)), " of the forces on the cutters"
    if judged == "agrees":
        judged = _PUT_IN.get(name, judged)
    yield _mean(f"table1.{name}.mean.cutters", of, paper, loads, judged, _CUTTER_NOTES.get(name, _OTHER_NOTE))
    judged = verdict.statement(_all_found(paper, loads))
    yield _lines(f"table1.{name}.lines.cutters", of, paper, loads, judged)


def _mean(stem: str, of: str, paper: LoadRow, loads: ComponentSummary, judged: RowVerdict, note: str) -> Row:
    ours = abs(loads.mean) / 1e3
    return Row(stem, f"{paper.name}, mean{of}", paper.mean / 1e3, ours, judged, note, paper.unit)


def _all_found(paper: LoadRow, found: ComponentSummary) -> bool:
    return all(
        verdict.line(wanted, line.found_hz) == "agrees" for wanted, line in zip(paper.lines, found.lines, strict=True)
    )


def _lines(stem: str, of: str, paper: LoadRow, found: ComponentSummary, judged: RowVerdict) -> Row:
    wanted = ", ".join(f"{value:g}" for value in paper.lines)
    ours = ", ".join("–" if line.found_hz is None else f"{line.found_hz:.2f}" for line in found.lines)
    regions = " and ".join(f"{low:g}–{high:g}" for low, high in paper.regions)
    note = f"{found.in_regions:.0%} of the fluctuation's power in Table 1's regions {regions} Hz"
    return Row(stem, f"{paper.name}, typical frequencies{of}", wanted, ours, judged, note, "Hz")


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in counts.items()) or "none described"
