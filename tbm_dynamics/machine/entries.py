"""What every entry of a machine file is made of."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, FiniteFloat, PositiveFloat


def _printable(text: str) -> str:
    """Text that a terminal, a picture and a page can show."""
    if not text.isprintable():
        raise ValueError("must be one line of printable characters")
    return text


Node = Annotated[int, Field(ge=1)]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Positive = Annotated[PositiveFloat, Field(allow_inf_nan=False)]
Vector3 = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
SixPositiveOrZero = tuple[NonNegative, NonNegative, NonNegative, NonNegative, NonNegative, NonNegative]
Line = Annotated[str, Field(min_length=1), AfterValidator(_printable)]
Source = Literal["table1", "table4", "table5", "assumed", "calibrated", "updated"]
ConnectionType = Literal["rock", "bolt", "bearing", "spline", "hydraulic", "steel"]
GROUND: Literal["ground"] = "ground"


class Entry(BaseModel):
    """Base of every entry: immutable, and a misspelt key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")
