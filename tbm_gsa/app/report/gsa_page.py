"""What people read of a sensitivity study: the HTML page, and it with the tables in the study's folder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from tbm_dynamics import load_machine
from tbm_gsa.app.report import gsa_figures as figures
from tbm_gsa.app.report.gsa_tables import gsa_tables
from tbm_gsa.app.report.page import PageHead, PageMachine, embed_figure, render_page
from tbm_gsa.provenance import machine_sha256, versions_text
from tbm_gsa.sensitivity.results import NOT_DETERMINED, REPORT_NAME, TABLES_NAME, OutputResult, StudyResult
from tbm_gsa.sensitivity.study.analysis import OutputFit
from tbm_gsa.sensitivity.study.inputs import Input, InputSet
from tbm_gsa.sensitivity.study.run import FinishedStudy
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.files import write_whole

if TYPE_CHECKING:
    from tbm_gsa.comparison.results import ExpectedLine

# Below the lowest R² the paper accepts (its Table 6, PAcc_A) the page says so.
POOR_R2: Final = 0.7


def write_study_report(study: FinishedStudy) -> None:
    """Write ``report.html`` and ``tables/*.csv`` of a finished study."""
    write_whole(study.folder / REPORT_NAME, gsa_page(study.result, study.fits).encode())
    tables = study.folder / TABLES_NAME
    tables.mkdir(exist_ok=True)
    for name, text in gsa_tables(study.result).items():
        write_whole(tables / name, text.encode())


def gsa_page(result: StudyResult, fits: Mapping[str, OutputFit]) -> str:
    """Render a study.

    Parameters
    ----------
    result : StudyResult
    fits : mapping of str to OutputFit
        Curves and samples, which the figures draw beside the result.

    Returns
    -------
    str
        A page that holds its figures and style.
    """
    inputs, samples = InputSet(tuple(map(Input.from_dict, result.inputs.values()))), result.samples
    head = PageHead(
        title="Global sensitivity of the driving system",
        subtitle=f"{len(inputs)} inputs, {len(result.outputs) + len(result.spectra)} outputs, "
        f"{samples.train} training and {samples.test} test points",
        data=f"simulations of this study, design {result.design}, seed {result.seed}; no recording",
        units="SI: accelerations in m/s², displacements in m, angles in rad, forces in N; inputs as their table says",
        machines=_machines(result.settings),
    )
    context = {
        "result": result,
        "unit": figures.output_unit,
        "poor": [name for name, output in result.outputs.items() if output.determined and output.r2_cv < POOR_R2],
        "doubts": result.doubts(),
        "not_determined": NOT_DETERMINED,
        "poor_limit": POOR_R2,
        "strongest": {name: output.strongest() for name, output in result.outputs.items()},
        "inputs": {item.code: item for item in inputs.inputs},
        "distances": {name: _distances(output) for name, output in result.outputs.items()},
        "provenance": _provenance(result),
        **(_figures(result.outputs, fits, inputs) if result.outputs else {}),
        **(_maps(result, inputs) if result.spectra else {}),
    }
    return render_page("gsa.html", head, context)


def _machines(settings: Mapping[str, str | int | float]) -> tuple[PageMachine, ...]:
    """Machine that was simulated; none where a study is one of functions."""
    named = (settings.get("machine"), settings.get("machine_sha256"))
    return (PageMachine(str(named[0]), str(named[0]), str(named[1])),) if all(named) else ()


def _distances(output: OutputResult) -> list[tuple[float, float]]:
    """Largest distance of sampled first-order and total indices from those the study reports, by base size."""
    return [
        (
            max(abs(index - output.first[code]) for code, index in step.first.items()),
            max(abs(index - output.total[code]) for code, index in step.total.items()),
        )
        for step in output.convergence
    ]


def _figures(outputs: Mapping[str, OutputResult], by_name: Mapping[str, OutputFit], inputs: InputSet) -> dict[str, str]:
    """Draw the figures as image elements."""
    fits = list(by_name.values())
    drawn = {
        "bars": (figures.index_bars(fits, inputs), "Bars of the Sobol indices of every output"),
        "curves": (figures.response_curves(fits, inputs), "Response along the strongest inputs"),
        "scores": (figures.score_bars(fits), "Bars of R² by output and surrogate"),
        "designs": (figures.design_points(fits, inputs), "Training and test points"),
        "predictions": (figures.prediction_scatter(fits), "Simulated against predicted values"),
    }
    if all(output.fast is not None for output in outputs.values()):
        drawn |= {
            "interactions": (figures.interaction_bars(outputs), "Bars of second-order indices"),
            "convergence": (figures.convergence(outputs), "First-order indices over the base size"),
            "split": (figures.uncertainty_split(outputs), "Bars of metamodel and sampling error"),
            "methods": (figures.method_comparison(outputs), "First-order indices by other methods"),
            "morris": (figures.morris_scatter(outputs), "Elementary effects, mean and deviation"),
        }
    return {name: embed_figure(figure, description) for name, (figure, description) in drawn.items()}


def _maps(result: StudyResult, inputs: InputSet) -> dict[str, str]:
    """Draw the maps of the spectra as an image element."""
    from tbm_gsa.app.report.gsa_spectrum_map import spectrum_maps  # noqa: PLC0415 - loads what reads recordings

    figure = spectrum_maps(result.spectra, inputs, _lines(result))
    return {"maps": embed_figure(figure, "Maps of total indices by band and input")}


def _lines(result: StudyResult) -> tuple[ExpectedLine, ...]:
    """Lines to expect of the machine that was studied; none where its file is gone or says something else now."""
    from tbm_gsa.comparison.expected import expected_lines  # noqa: PLC0415 - as above

    try:
        machine = load_machine(str(result.settings.get("machine")))
    except InputError:
        return ()
    return expected_lines(machine) if machine_sha256(machine) == result.settings.get("machine_sha256") else ()


def _provenance(result: StudyResult) -> dict[str, object]:
    """Where the numbers come from, as rows of a table."""
    return {
        **result.settings,
        "design": f"{result.design}, seed {result.seed}",
        "loads": f"{result.realisations} realisations" if result.realisations else "one realisation, common to all",
        "indices": result.indices,
        "time": f"{result.seconds:.1f} s in all, {result.campaign_seconds:.1f} s of it campaign; "
        f"{result.simulation_seconds:.1f} s of processor time in simulations",
        "versions": versions_text(result.versions),
    }
