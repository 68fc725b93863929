"""Global sensitivity analysis of a tunnel boring machine's drive: surrogates, Sobol indices, studies, reports."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tbm_gsa.sensitivity.sobol.closed_form import sobol_closed_form
    from tbm_gsa.sensitivity.sobol.monte_carlo import sobol_monte_carlo
    from tbm_gsa.sensitivity.surrogates import fit_surrogate

__all__ = ["fit_surrogate", "sobol_closed_form", "sobol_monte_carlo"]

# Loaded on first use: the worker processes of a campaign and the quick commands need neither scikit-learn nor SALib,
# which take longer to import than a short simulation takes to run.
_HOME = {
    "fit_surrogate": "tbm_gsa.sensitivity.surrogates",
    "sobol_closed_form": "tbm_gsa.sensitivity.sobol.closed_form",
    "sobol_monte_carlo": "tbm_gsa.sensitivity.sobol.monte_carlo",
}


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415 - its import takes a third of that of this package

        return version("tbm_monitor")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
