"""How long work says what it does while it goes on."""

from collections.abc import Callable
from typing import TypeAlias

Progress: TypeAlias = Callable[[str, float | None], None]
"""``progress(message, fraction)``: what is being done, and the share of it that is done, None where none is known."""
ShareDone: TypeAlias = Callable[[float], None]
"""``progress(share)``: the share that is done, 0 to 1."""
CountDone: TypeAlias = Callable[[int, int], None]
"""``progress(done, of)``: how much is done, and of how much."""
