"""Which input moves which part of a spectrum: components of its band levels, their surrogates, indices by band."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress
from typing import Final

import numpy as np
from numpy.typing import NDArray
from sklearn.metrics import r2_score

from tbm_gsa.sensitivity.sobol.closed_form import expansion_indices, with_jackknife
from tbm_gsa.sensitivity.sobol.indices import SobolIndices
from tbm_gsa.sensitivity.study.candidates import FOLDS, Data
from tbm_gsa.sensitivity.study.outputs import Band, bands_text, spectrum_bands
from tbm_gsa.sensitivity.study.store import Store
from tbm_gsa.sensitivity.surrogates.expansion import PolynomialExpansion
from tbm_gsa.sensitivity.surrogates.samples import checked_samples
from tbm_gsa.sensitivity.surrogates.vector import Components, VectorSurrogate
from tbm_gsa.signals.band_weights import leakage
from tbm_gsa.signals.windows import SEGMENT_S
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.progress import Progress

CONSTANT_DB: Final = 1e-9
"""Levels of a band that differ by less are the same."""
ROUNDS: Final = 2
"""Of effects and surrogate in turn; a third changes R² in the third digit."""
RANGE_DB: Final = 80.0
"""A band that lies farther below the loudest one is left out: sensors do not resolve it, nor do the transforms."""


@dataclass(frozen=True, eq=False)
class PartOfSpectrum:
    """What is found about a band, a component, or the whole of a spectrum.

    Parameters
    ----------
    indices : SobolIndices
        With intervals by the jackknife over the folds; mean in dB, variance in dB², of the whole summed over the bands.
    r2_cv : float
        R² of the cross validation.
    """

    indices: SobolIndices
    r2_cv: float


@dataclass(frozen=True, eq=False)
class SpectrumAnalysis:
    """Everything found about a spectrum.

    Parameters
    ----------
    bands : tuple of (float, float)
        Limits, Hz.
    level : ndarray, shape (n, b)
        RMS of the training simulations by band, dB over 1 m/s².
    components : Components
        Of the levels.
    by_band, by_component : tuple of PartOfSpectrum
    whole : PartOfSpectrum
    r2_test : float or None
        Of the whole on the test points; None where they are too few or do not vary.
    left_out : tuple of str
        Which bands, and why.
    """

    bands: tuple[Band, ...]
    level: Array
    components: Components
    by_band: tuple[PartOfSpectrum, ...]
    by_component: tuple[PartOfSpectrum, ...]
    whole: PartOfSpectrum
    r2_test: float | None
    left_out: tuple[str, ...]


def analyse_spectra(
    store: Store, *, seed: int = 0, progress: Progress | None = None
) -> tuple[dict[str, SpectrumAnalysis], dict[str, str]]:
    """Analyse the spectra of a store.

    Parameters
    ----------
    store : Store
    seed : int
        Of fits and cross validations.
    progress : callable, optional
        Called before every spectrum, see `Progress`.

    Returns
    -------
    found : dict of str to SpectrumAnalysis
        By ``spectrum_POINT_AXIS``, in the order of the store's outputs.
    skipped : dict of str to str
        Why there is nothing to say of a spectrum.
    """
    names, inputs = store.problem.outputs, store.problem.inputs
    (X, Y), (X_test, Y_test) = store.results("train"), store.results("test")
    unit, test_unit = inputs.to_unit(X), inputs.to_unit(X_test)
    shared, test_shared = store.realisations("train"), store.realisations("test")
    realisations = None if shared is None or test_shared is None else (shared, test_shared)
    found: dict[str, SpectrumAnalysis] = {}
    skipped: dict[str, str] = {}
    spectra = spectrum_bands(names)
    for done, (whole, bands) in enumerate(spectra.items()):
        if progress is not None:
            progress(f"spectrum {done} of {len(spectra)}", done / len(spectra))
        columns = [names.index(name) for name in bands]
        data = Data(unit, Y[:, columns], test_unit, Y_test[:, columns])
        try:
            found[whole] = analyse_spectrum(tuple(bands.values()), data, seed, realisations)
        except InputError as error:
            skipped[whole] = str(error)
    return found, skipped


def analyse_spectrum(
    bands: Sequence[Band], data: Data, seed: int, realisations: tuple[Integers, Integers] | None = None
) -> SpectrumAnalysis:
    """Analyse one spectrum.

    The levels of its bands are decomposed (`Components`), every component gets a sparse polynomial surrogate, and the
    indices of each band follow in closed form (`VectorSurrogate`). In the cross validation components, surrogates and
    effects of realisations are found anew without the samples that are held out.

    Parameters
    ----------
    bands : sequence of (float, float)
        Limits, Hz, lowest first.
    data : Data
        With the RMS by band as values, (n, b), m/s².
    seed : int
    realisations : tuple of 2 ndarrays of int, shapes (n,) and (m,), optional
        Of the loads, numbered from 0, of the training and the test simulations where these share out several.

    Raises
    ------
    InputError
        Too few simulations, or no band is left.
    """
    kept, left_out = _kept(bands, data.values)
    level = _decibels(data.values[:, kept])
    checked_samples(data.unit, level[:, 0], data.bounds)  # the same points carry all bands
    test_rms = data.test_values[:, kept]
    labels, test_labels = realisations or [np.zeros(len(rows), dtype=np.int64) for rows in (level, test_rms)]
    surrogate, effects = _fit(data.unit, level, labels, seed)
    components = Components.of(level - _on(effects, labels))
    models, actual, predicted = [], np.empty_like(level), np.empty_like(level)
    for held_out in _folds(len(level), seed):
        rows = np.setdiff1d(np.arange(len(level)), held_out)
        model, known = _fit(data.unit[rows], level[rows], labels[rows], seed)
        models.append(model)
        actual[held_out] = level[held_out] - _on(known, labels[held_out])
        predicted[held_out] = model.evaluate(data.unit[held_out])

    def part(expansions: Sequence[PolynomialExpansion], r2: float) -> PartOfSpectrum:
        """Judge the expansion of all samples, the first, by those of the folds."""
        indices, *without = map(expansion_indices, expansions)
        return PartOfSpectrum(with_jackknife(indices, without), r2)

    def along(directions: Array) -> tuple[PartOfSpectrum, ...]:
        scores = r2_score(actual @ directions, predicted @ directions, multioutput="raw_values")
        return tuple(
            part([model.along(direction) for model in (surrogate, *models)], float(r2))
            for direction, r2 in zip(directions.T, scores, strict=True)
        )

    tested = len(test_rms) > 1 and test_rms.min() > 0.0 and np.ptp(test_rms, axis=0).any()
    return SpectrumAnalysis(
        bands=tuple(compress(bands, kept)),
        level=level,
        components=components,
        by_band=along(np.eye(level.shape[1])),
        by_component=along(components.shapes),
        whole=part([model.together for model in (surrogate, *models)], _r2(actual, predicted)),
        r2_test=_r2(_decibels(test_rms) - _on(effects, test_labels), surrogate.evaluate(data.test_unit))
        if tested
        else None,
        left_out=left_out,
    )


def _fit(unit: Array, level: Array, labels: Integers, seed: int) -> tuple[VectorSurrogate, Array]:
    """Fit a surrogate to levels (n, b), and the effects (k, b) of the loads' realisations, if there are several.

    The effects are what the residuals of a surrogate have in common under a realisation, and the next surrogate is
    that of the levels without them (backfitting).
    """
    surrogate, effects = VectorSurrogate.fit(unit, level, seed), np.zeros((1, level.shape[1]))
    for _ in range(ROUNDS if labels.max() > labels.min() else 0):
        effects = realisation_effects(level - surrogate.evaluate(unit), labels)
        surrogate = VectorSurrogate.fit(unit, level - _on(effects, labels), seed)
    return surrogate, effects


def realisation_effects(residuals: Array, labels: Integers) -> Array:
    """Estimate random effects (k, b) of groups of residuals (n, b), which bear labels (n,) from 0 on, in b columns.

    Means of the groups, drawn towards 0 by the share of their variance that is the error of a mean, 0 of a group that
    has no residual (best linear unbiased prediction; G. K. Robinson, Statistical Science 6 (1991) 15–32).
    """
    there, place, count = np.unique(labels, return_inverse=True, return_counts=True)
    means = np.zeros((len(there), residuals.shape[1]))
    np.add.at(means, place, residuals)
    means /= count[:, None]
    within = np.square(residuals - means[place]).sum(axis=0) / max(1, len(residuals) - len(there))
    means -= means.mean(axis=0)
    spread = np.square(means).sum(axis=0) / max(1, len(there) - 1)
    real = np.maximum(spread - within * np.mean(1.0 / count), 0.0)
    effects = np.zeros((int(labels.max()) + 1, residuals.shape[1]))
    effects[there] = means * np.divide(real, spread, out=np.zeros_like(spread), where=spread > 0.0)
    return effects


def _on(effects: Array, labels: Integers) -> Array:
    """Effects (n, b) on simulations under given realisations (n,); 0 where nothing is known of one."""
    unknown = np.zeros((1, effects.shape[1]))
    return np.concatenate([effects, unknown])[np.minimum(labels, len(effects))]


def _folds(count: int, seed: int) -> list[Integers]:
    """Rows that are held out together, as `Surrogate.cross_validate` has them."""
    return np.array_split(np.random.default_rng(seed).permutation(count), min(FOLDS, count))


def _r2(actual: Array, predicted: Array) -> float:
    """R² of all bands together, each with the weight of its variance."""
    return float(r2_score(actual, predicted, multioutput="variance_weighted"))


def _decibels(rms: Array) -> Array:
    return np.asarray(20.0 * np.log10(rms))


def _kept(bands: Sequence[Band], rms: Array) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Find the bands with something of their own to say (b,), and sentences about all others.

    A band whose power does not exceed what the transforms leak into it from the other bands, in half of the
    simulations or more, would show the inputs of its loud neighbours.
    """
    power = np.square(rms)
    floor = np.maximum(power @ leakage(bands, SEGMENT_S).T, 10.0 ** (-RANGE_DB / 10.0) * power.max(axis=1)[:, None])
    heard = np.mean(power > floor, axis=0) > 0.5
    whole = (power > 0.0).all(axis=0)
    moved = np.zeros(len(bands), dtype=np.bool_)
    moved[whole] = np.ptp(_decibels(rms[:, whole]), axis=0) > CONSTANT_DB
    reasons = {
        f"quiet ({RANGE_DB:g} dB below the loudest, or masked by leakage)": ~heard,
        "constant": heard & whole & ~moved,
        "no motion in some simulation": heard & ~whole,
    }
    left_out = [
        f"{bands_text(list(compress(bands, chosen)))}: {why}" for why, chosen in reasons.items() if chosen.any()
    ]
    kept = heard & whole & moved
    if not kept.any():
        raise InputError("; ".join(left_out))
    ends = bands[0][0], bands[-1][1]
    never = "below {:g}, above {:g} Hz: no third octave of {:g} Hz or more".format(*ends, 1.0 / SEGMENT_S)
    return kept, (never, *left_out)
