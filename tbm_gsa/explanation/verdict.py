"""Whether an explanation explains: its probabilities only rank the causes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

LARGEST_MISFIT: Final = 2.0
"""Standard deviations that the statistics may be off by (root mean square) where a cause explains a recording."""


def explains(standardised_misfit: float) -> bool:
    """Judge what a cause leaves, in standard deviations."""
    return standardised_misfit <= LARGEST_MISFIT


def verdict(document: Mapping[str, Any]) -> str:
    """Say whether the first cause of an explanation explains the recording, and whether all inputs together could."""
    first, off = document["causes"][0], document["standardised_misfit"]
    if first["input"] is None:
        subject, size = "that nothing has changed", off["model"]
    else:
        subject, size = f"{first['input']} alone", off["checked"]
    judged = "explains" if document["explained"] else "does not explain"
    text = f"{subject} {judged} the recording: {size:.1f} standard deviations off (RMS)"
    if document["explained"]:
        return text
    together = document["joint"]["standardised_misfit"]
    more = (
        f"all inputs together could ({together:.1f} as predicted)"
        if explains(together)
        else f"nor do all inputs together ({together:.1f}): look for what the model does not have, or at the sensors"
    )
    return f"{text}, at most {LARGEST_MISFIT:g} allowed; the probabilities only rank the causes; {more}"
