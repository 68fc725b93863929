"""How a recording and the model are compared."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from tbm_dynamics.integration import DEFAULT_STEP

MODEL_RATE_HZ: Final = 1.0 / DEFAULT_STEP
"""Of the runs of a model whose meshes need no shorter step."""


@dataclass(frozen=True)
class Settings:
    """How to compare.

    Attributes
    ----------
    window_s : float
        Length of a window.
    high_hz : float or None
        Upper limit of the band; by default what `common_band` gives.
    bands : tuple of (float, float)
        Bands whose RMS is given, Hz; a comparison without any takes those of the machine.
    expected_lines : mapping of str to float
        Frequencies in Hz by name, e.g. the loads' lines and the mesh frequency.
    line_count : int
        Strongest lines per axis.
    resolution_hz : float
        Of the spectra.
    model_rate_hz : float
        Of the runs of the model.
    spectrogram : bool
        Whether spectrograms are wanted, which a page draws.
    """

    window_s: float = 2.0
    high_hz: float | None = None
    bands: tuple[tuple[float, float], ...] = ()
    expected_lines: Mapping[str, float] = field(default_factory=dict)
    line_count: int = 5
    resolution_hz: float = 0.25
    model_rate_hz: float = MODEL_RATE_HZ
    spectrogram: bool = False


def band_name(low: float, high: float) -> str:
    """Key of a band in documents."""
    return f"{low:g}-{high:g}_hz"
