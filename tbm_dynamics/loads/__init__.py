"""The six load components on the cutterhead (N, N·m) as a pure function of (seed, time)."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tbm_dynamics.loads.description import COMPONENTS, LoadComponent, LoadDescription, LoadLine, LoadRegion
    from tbm_dynamics.loads.spectral import SpectralLoads

__all__ = ["COMPONENTS", "LoadComponent", "LoadDescription", "LoadLine", "LoadRegion", "SpectralLoads"]

# Loaded on first use: what describes the loads needs no compiled code.
_HOME = {
    "COMPONENTS": "tbm_dynamics.loads.description",
    "LoadComponent": "tbm_dynamics.loads.description",
    "LoadDescription": "tbm_dynamics.loads.description",
    "LoadLine": "tbm_dynamics.loads.description",
    "LoadRegion": "tbm_dynamics.loads.description",
    "SpectralLoads": "tbm_dynamics.loads.spectral",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
