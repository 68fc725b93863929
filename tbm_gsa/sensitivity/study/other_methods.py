"""Other ways of asking the surrogates of a study: they take longer than the indices, and say how far to trust them."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from tbm_gsa.sensitivity.screening import ElementaryEffects, fast_indices, morris_effects
from tbm_gsa.sensitivity.sobol.indices import SobolIndices, of_a_constant
from tbm_gsa.sensitivity.sobol.monte_carlo import ConvergenceStep, convergence_sizes, sobol_convergence
from tbm_gsa.sensitivity.sobol.of_surrogate import is_constant, sobol_of_surrogate
from tbm_gsa.sensitivity.sobol.paths import PathIndices, sobol_of_paths
from tbm_gsa.sensitivity.study.analysis import OutputFit, strongest
from tbm_gsa.sensitivity.study.workers import WorkerPool, as_ended
from tbm_gsa.sensitivity.surrogates.krg import Kriging
from tbm_msgs_py.base.progress import Progress


@dataclass(frozen=True, eq=False)
class OtherMethods:
    """What other ways of asking say about an output.

    Parameters
    ----------
    pairs : SobolIndices
        Of the chosen surrogate, with second order.
    surrogates : mapping of str to SobolIndices
        Of every method's surrogate: how far the indices depend on which one is chosen.
    paths : PathIndices or None
        Over conditional paths of the Kriging surrogate; None where it was not asked for.
    convergence : tuple of ConvergenceStep
        Saltelli sampling of the chosen surrogate with more and more samples.
    places : tuple of int
        Inputs the convergence was followed for: the strongest, strongest first.
    fast : SobolIndices
        Of the chosen surrogate.
    morris : ElementaryEffects
        Of the chosen surrogate.
    """

    pairs: SobolIndices
    surrogates: Mapping[str, SobolIndices]
    paths: PathIndices | None
    convergence: tuple[ConvergenceStep, ...]
    places: tuple[int, ...]
    fast: SobolIndices
    morris: ElementaryEffects


def ask_other_methods(
    fits: Mapping[str, OutputFit],
    *,
    seed: int = 0,
    processes: WorkerPool | None = None,
    progress: Progress | None = None,
) -> Mapping[str, OtherMethods]:
    """Ask all other methods about the outputs of a study.

    Parameters
    ----------
    fits : mapping of str to OutputFit
    seed, processes, progress
        As of `fit_outputs`.
    """
    if not fits:  # of whole spectra alone there is nothing to ask
        return {}
    report = progress or (lambda *_: None)
    report(f"other methods 0 of {len(fits)} outputs", 0.0)
    found: dict[str, OtherMethods] = {}
    for name, other in as_ended(partial(_ask, seed=seed), tuple(fits.values()), processes):
        found[name] = other
        report(f"other methods {len(found)} of {len(fits)} outputs", len(found) / len(fits))
    return {name: found[name] for name in fits}


def _ask(fit: OutputFit, seed: int) -> tuple[str, OtherMethods]:
    """Apply the other methods to one output; the indices of the chosen surrogate are there already."""
    best, indices = fit.best, fit.indices
    predict, bounds = best.model.predict, best.model.bounds
    places, still = tuple(strongest(indices)), is_constant(best.model)
    if still:
        nothing = of_a_constant(len(places), indices.mean)
        steps = tuple(ConvergenceStep(asked, size, nothing) for size, asked in convergence_sizes().items())
    else:
        steps = sobol_convergence(predict, bounds, seed=seed, groups=[(k,) for k in places])
    return fit.name, OtherMethods(
        pairs=sobol_of_surrogate(best.model, best.validation, second=True, seed=seed),
        surrogates={
            method: indices if candidate is best else sobol_of_surrogate(candidate.model, seed=seed)
            for method, candidate in fit.candidates.items()
        },
        paths=_path_indices(fit, seed),
        convergence=steps,
        places=places,
        fast=of_a_constant(len(bounds), indices.mean) if still else fast_indices(predict, bounds, seed=seed),
        morris=morris_effects(predict, bounds, seed=seed),
    )


def _path_indices(fit: OutputFit, seed: int) -> PathIndices | None:
    """Find indices over conditional paths of the Kriging surrogate, if there is one."""
    if Kriging.method not in fit.candidates:
        return None
    model = fit.candidates[Kriging.method].model
    assert isinstance(model, Kriging)  # noqa: S101 - for the type checker
    return None if is_constant(model) else sobol_of_paths(model, seed=seed)
