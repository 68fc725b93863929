"""Table 6 and Figures 8 to 10: the design and how well the surrogates follow the model."""

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from tbm_gsa.paper.reproduction import verdict
from tbm_gsa.paper.reproduction.readings import Reading
from tbm_gsa.paper.reproduction.row import Row
from tbm_gsa.paper.reproduction.studies import Study
from tbm_gsa.paper.surrogates import (
    BEST_ON_TEST,
    CHOSEN,
    LEAST_TEST_R2,
    METHODS,
    TABLE_6,
    TEST,
    TRAIN,
    WORST_ON_TEST,
)
from tbm_gsa.sensitivity.study.analysis import OutputFit
from tbm_gsa.sensitivity.study.candidates import Candidate

_NAMES: Final = {"rbf": "RBF", "krg": "KRG", "svr": "SVR"}


def surrogate_rows(reading: Reading, study: Study) -> Iterator[Row]:
    """Rows of Table 6 and Figures 8 to 10 under one reading."""
    if reading.own:
        ours = f"{study.train} + {study.test}"
        note = f"{study.failed} simulations failed" if study.failed else "Latin hypercubes"
        what = "training and test points"
        same = verdict.echoed((study.train, study.test) == (TRAIN, TEST))
        yield Row("figure8.points", "Figure 8", what, f"{TRAIN} + {TEST}", ours, same, note)
    for name, paper in TABLE_6.items():
        yield from _cross_validated(reading, paper, study.outputs[name])
    yield _best_method(reading, study.outputs)
    for name in TABLE_6:
        yield _followed(reading, study.outputs[name].best, name)
    yield from _tested(reading, study.outputs)


def _cross_validated(reading: Reading, paper: Mapping[str, float], analysis: OutputFit) -> Iterator[Row]:
    name, best = analysis.name, analysis.best
    wanted = max(paper.values())
    yield Row(
        reading.id(f"table6.{name}.best"),
        "Table 6",
        f"R² ten-fold of {name}, best of RBF, KRG and SVR",
        wanted,
        best.r2_cv,
        verdict.r_squared(wanted, best.r2_cv),
        _label(best),
        reading=reading.name,
    )
    for method, value in paper.items():
        candidate = analysis.candidates[method]
        yield Row(
            reading.id(f"table6.{name}.{method}"),
            "Table 6",
            f"R² ten-fold of {name}, {_NAMES[method]}",
            value,
            candidate.r2_cv,
            verdict.r_squared(value, candidate.r2_cv),
            _label(candidate),
            reading=reading.name,
        )


def _label(candidate: Candidate) -> str:
    of = " of the output's logarithm" if candidate.transform == "log" else ""
    return f"{_NAMES.get(candidate.model.method, candidate.model.method)}{of}"


def _best_method(reading: Reading, analyses: Mapping[str, OutputFit]) -> Row:
    means = {name: float(np.mean([one.candidates[name].r2_cv for one in analyses.values()])) for name in METHODS}
    best = max(means, key=means.__getitem__)
    return Row(
        reading.id("table6.method"),
        "Table 6",
        "surrogate of the highest accuracy",
        _NAMES[CHOSEN],
        _NAMES[best],
        verdict.statement(best == CHOSEN),
        "mean R² ten-fold over the outputs: "
        + ", ".join(f"{_NAMES[name]} {value:.3f}" for name, value in means.items()),
        reading=reading.name,
    )


def _followed(reading: Reading, best: Candidate, name: str) -> Row:
    """Figure 9 shows simulations beside approximations without a number."""
    ours = f"held-out error {best.validation.rmse:.3g} (RMS)"
    what = f"simulations and approximations of {name}"
    identity = reading.id(f"figure9.{name}")
    return Row(identity, "Figure 9", what, "close together", ours, "no number", _label(best), reading=reading.name)


def _tested(reading: Reading, analyses: Mapping[str, OutputFit]) -> Iterator[Row]:
    scores = {name: analyses[name].best.r2_test for name in TABLE_6}
    for name, score in scores.items():
        yield Row(
            reading.id(f"figure10.{name}"),
            "Figure 10",
            f"R² of {name} on the test points",
            f"> {LEAST_TEST_R2:g}",
            score,
            "differs" if score is None else verdict.above(LEAST_TEST_R2, score),
            _label(analyses[name].best),
            reading=reading.name,
        )
    known = {name: score for name, score in scores.items() if score is not None}
    ranked = sorted(known, key=known.__getitem__)
    statements = (
        ("lowest", WORST_ON_TEST, ranked[:1], ranked[:1] == [WORST_ON_TEST]),
        ("highest", "RDef_A, RDef_L, RDef_R", ranked[-3:], set(ranked[-3:]) == set(BEST_ON_TEST)),
    )
    for which, paper, ours, holds in statements:
        what = f"outputs of the {which} R² on the test points"
        judged = verdict.statement(holds)
        identity = reading.id(f"figure10.{which}")
        yield Row(identity, "Figure 10", what, paper, ", ".join(sorted(ours)), judged, reading=reading.name)
