"""The HTML page of a reproduction: table by table, figure by figure, ours beside the paper's."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from matplotlib.figure import Figure

from tbm_gsa.app.report import compare_figures, gsa_figures
from tbm_gsa.app.report.load_figure import load_figure
from tbm_gsa.app.report.machine_drawing import draw_machine
from tbm_gsa.app.report.page import PageHead, PageMachine, embed_figure, recorded_at, render_page
from tbm_gsa.app.report.reproduction_figures import line_figure, mesh_figure, trend_figure
from tbm_gsa.paper.published import ACCELERATION_LINE_HZ
from tbm_gsa.paper.reproduction.result import SOURCES, ReproductionResult, Row, Value
from tbm_gsa.paper.reproduction.verdict import VERDICTS
from tbm_gsa.paper.reproduction.workflow import Reproduction
from tbm_gsa.provenance import versions_text
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS

TITLES: Final = {
    "Table 1": "Mean values and main frequencies of the loads",
    "Table 2": "Measured and predicted axial acceleration",
    "Table 3": "Outputs",
    "Table 4": "Inputs and their ranges",
    "Table 5": "Coupling stiffness",
    "Table 6": "R² of ten-fold cross validation",
    "Figure 2": "The dynamic model",
    "Figure 3": "Mesh stiffness and error over time",
    "Figure 4": "Cutterhead and its loads",
    "Figure 5": "Axial acceleration and mesh force",
    "Figure 6": "Measuring points and their topics",
    "Figure 7": "Acceleration at the cutterhead, RMS at the test points",
    "Figure 8": "Training and test points",
    "Figure 9": "Simulations and their approximations",
    "Figure 10": "R² on the test points",
    "Figure 11": "Sensitivity of the displacement",
    "Figure 12": "Displacement and lateral acceleration along their parameters",
    "Figure 13": "Sensitivity of the acceleration",
    "Figure 14": "Sensitivity of the mesh force",
    "Figure 15": "Mesh force along its parameters",
}


@dataclass(frozen=True)
class PageSection:
    """A table or figure of the paper: rows with the other reading's beside them, images with their captions."""

    source: str
    title: str
    rows: list[tuple[Row, Row | None]]
    pictures: list[tuple[str, str]]

    @property
    def both(self) -> bool:
        """Whether the reading of the dampings plays a part."""
        return any(other for _, other in self.rows)


def reproduction_page(found: Reproduction) -> str:
    """Render a reproduction as a page that holds its figures and style."""
    result = found.result
    recording = found.responses[0].comparison.result.recording
    head = PageHead(
        title="The paper, reproduced",
        subtitle="Surrogate-Based Multisource Sensitivity Analysis of TBM Driving System (2018)",
        data=f"simulations, seed {result.seed}; {recorded_at(recording.begin, recording.duration)}",
        units="as the paper has them: accelerations of test points in g, 9.80665 m/s², those of outputs (PAcc) in m/s²",
        machines=(PageMachine.of(result.machine, result.machine_file),),
    )
    context = {
        "result": result,
        "verdicts": VERDICTS,
        "own": result.readings[0],
        "other": result.readings[1],
        "sections": list(_sections(found)),
        "text": value_text,
        "anchor": anchor,
        "provenance": _provenance(result),
    }
    return render_page("reproduction.html", head, context)


def value_text(value: Value) -> str:
    """Write a value to four digits."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    return f"{value:.0f}" if abs(value) >= 1e4 and value < 1e6 else f"{value:.4g}"


def anchor(source: str) -> str:
    """Id of the section of a table or figure."""
    return source.lower().replace(" ", "")


def _sections(found: Reproduction) -> Iterator[PageSection]:
    result = found.result
    other = {row.id.partition("@")[0]: row for row in result.rows_of(result.readings[1].name)}
    pictures = _pictures(found)
    for source in SOURCES:
        rows = [(row, other.get(row.id)) for row in result.own_rows if row.source == source]
        yield PageSection(source, TITLES[source], rows, pictures.get(source, []))


def _pictures(found: Reproduction) -> dict[str, list[tuple[str, str]]]:
    """Image elements with their captions by figure of the paper."""
    pictures: dict[str, list[tuple[str, str]]] = {}
    for source, figure, caption in (*_machine(found), *_response(found), *_studies(found)):
        pictures.setdefault(source, []).append(
            (embed_figure(figure, f"{source}: {TITLES[source]}. {caption}"), caption)
        )
    return pictures


def _machine(found: Reproduction) -> Iterator[tuple[str, Figure, str]]:
    machine = found.readings[0].machine
    yield (
        "Figure 2",
        draw_machine(machine),
        f"Side view and drives of machine {machine.name}: nodes, shafts, connections; test points marked.",
    )
    yield "Figure 3", mesh_figure(found.mesh), "The first three pinions: each has the mesh phase of its place."
    caption = "First ten seconds and spectrum of each component, Table 1's regions shaded and its lines dotted"
    yield "Figure 4", load_figure(found.loads.spectral), f"{caption}: spectral level."
    if found.loads.cutter is not None:
        yield "Figure 4", load_figure(found.loads.cutter), f"{caption}: forces on the cutters."


def _response(found: Reproduction) -> Iterator[tuple[str, Figure, str]]:
    for evidence in found.responses:
        lines = line_figure(
            evidence.acceleration,
            evidence.mesh_force,
            [*evidence.axial_hz, ACCELERATION_LINE_HZ],
            list(evidence.mesh_lines_hz),
        )
        yield "Figure 5", lines, f"Dampings: {evidence.reading.title}."
    compared = found.responses[0].comparison
    excerpt = compared.excerpts.get("cutterhead", next(iter(compared.excerpts.values())))
    yield (
        "Figure 7",
        compare_figures.time_series(*excerpt, compare_figures.GRAVITY),
        "A second of the axial acceleration; the recording is synthetic.",
    )
    flow = compare_figures.power_flow(compared.result, compare_figures.GRAVITY)
    yield "Figure 7", flow, "RMS at the test points in each direction, with 95 % intervals."


def _studies(found: Reproduction) -> Iterator[tuple[str, Figure, str]]:
    for study in found.studies:
        analyses, by = study.outputs, f"Dampings: {study.reading.title}."
        every = list(analyses.values())
        if study.reading.own:
            yield "Figure 8", gsa_figures.design_points(every, PAPER_INPUTS), "Over the strongest input of each output."
            yield (
                "Figure 9",
                gsa_figures.prediction_scatter(every),
                "Training points held out in cross validation, and test points.",
            )
        yield "Figure 10", gsa_figures.score_bars(every), by
        for figure, start in (("Figure 11", "RDef"), ("Figure 13", "PAcc"), ("Figure 14", "MF")):
            chosen = [analysis for name, analysis in analyses.items() if name.startswith(start)]
            yield figure, gsa_figures.index_bars(chosen, PAPER_INPUTS), f"First and total indices. {by}"
        for figure, names in (("Figure 12", ("RDef_A", "PAcc_L")), ("Figure 15", ("MF_M", "MF_Se"))):
            drawn = trend_figure(study.curves, names, PAPER_INPUTS)
            yield figure, drawn, f"Mean of the chosen surrogate over the design, SI units. {by}"


def _provenance(result: ReproductionResult) -> dict[str, object]:
    """Where the numbers come from, as rows of a table."""
    sizes, recording = result.sizes, result.recording
    return {
        "machine": f"{result.machine} ({result.machine_file.origin})",
        "SHA-256 of the machine": result.machine_file.sha256,
        "recording": f"{recording.path}{' (synthetic)' if recording.synthetic else ''}",
        "SHA-256 of the recording": recording.sha256,
        "campaigns": f"{sizes.train} + {sizes.test} simulations of {sizes.simulation_s:g} s, "
        f"{sizes.other_train} + {sizes.test} under the other reading",
        "runs": f"{sizes.run_s:g} s; {sizes.model_s:g} s beside the recording; loads {sizes.loads_s:g} s",
        "loads of a campaign": result.loads,
        "seed": result.seed,
        "time": ", ".join(f"{name} {value:.1f} s" for name, value in result.seconds.items()),
        "versions": versions_text(result.versions),
    }
