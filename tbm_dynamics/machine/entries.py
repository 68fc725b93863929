"""What every entry of a machine file is made of."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, PositiveFloat

Node = Annotated[int, Field(ge=1)]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Positive = Annotated[PositiveFloat, Field(allow_inf_nan=False)]
Vector3 = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
SixPositiveOrZero = tuple[NonNegative, NonNegative, NonNegative, NonNegative, NonNegative, NonNegative]
ConnectionType = Literal["rock", "bolt", "bearing", "spline", "hydraulic", "steel"]
GROUND: Literal["ground"] = "ground"


class Entry(BaseModel):
    """Base of every entry: immutable, and a misspelt key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")
