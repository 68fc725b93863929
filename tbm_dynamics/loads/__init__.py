"""The six load components on the cutterhead (N, N·m) as a pure function of (seed, time)."""

from tbm_dynamics.loads.description import COMPONENTS, LoadComponent, LoadDescription, LoadLine, LoadRegion
from tbm_dynamics.loads.spectral import SpectralLoads

__all__ = ["COMPONENTS", "LoadComponent", "LoadDescription", "LoadLine", "LoadRegion", "SpectralLoads"]
