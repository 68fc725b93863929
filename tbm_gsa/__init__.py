"""Global sensitivity analysis of a tunnel boring machine's drive: surrogates, Sobol indices, studies, reports."""

from typing import TYPE_CHECKING

from tbm_msgs_py.base.lazy import lazy_names

if TYPE_CHECKING:
    from tbm_gsa.sensitivity.sobol.closed_form import sobol_closed_form
    from tbm_gsa.sensitivity.sobol.monte_carlo import sobol_monte_carlo
    from tbm_gsa.sensitivity.surrogates import fit_surrogate

__all__ = ["fit_surrogate", "sobol_closed_form", "sobol_monte_carlo"]

# The worker processes of a campaign and the quick commands need neither scikit-learn nor SALib, which take longer to
# import than a short simulation takes to run.
_public = lazy_names(
    __name__,
    {
        "tbm_gsa.sensitivity.sobol.closed_form": "sobol_closed_form",
        "tbm_gsa.sensitivity.sobol.monte_carlo": "sobol_monte_carlo",
        "tbm_gsa.sensitivity.surrogates": "fit_surrogate",
    },
)


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version  # noqa: PLC0415 - its import takes a third of that of this package

        return version("tbm_monitor")
    return _public(name)
