"""The context of a machine: ring, chainage, rock class and shift."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

ContextKey = Literal["ring", "chainage", "rock_class", "shift"]
CONTEXT_KEYS: Final[tuple[ContextKey, ...]] = get_args(ContextKey)


@dataclass(frozen=True, slots=True)
class Context:
    """Where the machine is and who drives it, as the site says; None where it does not.

    Attributes
    ----------
    ring : int, optional
        Number of the ring being built.
    chainage : float, optional
        Along the tunnel, m.
    rock_class : str, optional
    shift : str, optional
    """

    ring: int | None = None
    chainage: float | None = None
    rock_class: str | None = None
    shift: str | None = None


UNKNOWN: Final = Context()
