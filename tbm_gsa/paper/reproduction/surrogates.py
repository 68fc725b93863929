"""Table 6 and Figures 8 to 10: the design and how well the surrogates follow the model."""

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from tbm_gsa.paper.published import BEST_ON_TEST, CHOSEN, LEAST_TEST_R2, METHODS, TABLE_6, TEST, TRAIN, WORST_ON_TEST
from tbm_gsa.paper.reproduction import verdict
from tbm_gsa.paper.reproduction.readings import Reading
from tbm_gsa.paper.reproduction.result import Row
from tbm_gsa.paper.reproduction.studies import Study
from tbm_gsa.sensitivity.study.analysis import OutputFit
from tbm_gsa.sensitivity.study.candidates import Candidate

_NAMES: Final = {"rbf": "RBF", "krg": "KRG", "svr": "SVR"}


def surrogate_rows(study: Study) -> Iterator[Row]:
    """Rows of Table 6 and Figures 8 to 10 under one reading."""
    reading, sizes = study.reading, (study.campaign.train, study.campaign.test)
    if reading.own:
        ours = f"{sizes[0]} + {sizes[1]}"
        note = f"{study.failed} simulations failed" if study.failed else "Latin hypercubes"
        same = verdict.echoed(sizes == (TRAIN, TEST))
        yield Row("figure8.points", "training and test points", f"{TRAIN} + {TEST}", ours, same, note)
    for name, paper in TABLE_6.items():
        yield from _cross_validated(reading, paper, study.outputs[name])
    yield _best_method(reading, study.outputs)
    for name in TABLE_6:
        # Figure 9 shows simulations beside approximations without a number.
        best, what = study.outputs[name].best, f"simulations and approximations of {name}"
        ours = f"held-out error {best.validation.rmse:.3g} (RMS)"
        yield reading.row(f"figure9.{name}", what, "close together", ours, "no number", _label(best))
    yield from _tested(reading, study.outputs)


def _cross_validated(reading: Reading, paper: Mapping[str, float], analysis: OutputFit) -> Iterator[Row]:
    compared = [("best", "best of RBF, KRG and SVR", max(paper.values()), analysis.best)]
    compared += [(name, _NAMES[name], value, analysis.candidates[name]) for name, value in paper.items()]
    for key, which, wanted, candidate in compared:
        ours, what = candidate.r2_cv, f"R² ten-fold of {analysis.name}, {which}"
        judged = verdict.r_squared(wanted, ours)
        yield reading.row(f"table6.{analysis.name}.{key}", what, wanted, ours, judged, _label(candidate))


def _label(candidate: Candidate) -> str:
    of = " of the output's logarithm" if candidate.transform == "log" else ""
    return f"{_NAMES.get(candidate.model.method, candidate.model.method)}{of}"


def _best_method(reading: Reading, analyses: Mapping[str, OutputFit]) -> Row:
    means = {name: float(np.mean([one.candidates[name].r2_cv for one in analyses.values()])) for name in METHODS}
    best, what = max(means, key=means.__getitem__), "surrogate of the highest accuracy"
    numbers = ", ".join(f"{_NAMES[name]} {value:.3f}" for name, value in means.items())
    note, judged = f"mean R² ten-fold over the outputs: {numbers}", verdict.statement(best == CHOSEN)
    return reading.row("table6.method", what, _NAMES[CHOSEN], _NAMES[best], judged, note)


def _tested(reading: Reading, analyses: Mapping[str, OutputFit]) -> Iterator[Row]:
    known: dict[str, float] = {}
    for name in TABLE_6:
        best, what = analyses[name].best, f"R² of {name} on the test points"
        score = best.r2_test
        if score is not None:
            known[name] = score
        judged = "differs" if score is None else verdict.above(LEAST_TEST_R2, score)
        yield reading.row(f"figure10.{name}", what, f"> {LEAST_TEST_R2:g}", score, judged, _label(best))
    ranked = sorted(known, key=known.__getitem__)
    for which, paper, ours in (("lowest", (WORST_ON_TEST,), ranked[:1]), ("highest", BEST_ON_TEST, ranked[-3:])):
        what, judged = f"outputs of the {which} R² on the test points", verdict.statement(set(ours) == set(paper))
        yield reading.row(f"figure10.{which}", what, ", ".join(paper), ", ".join(sorted(ours)), judged)
