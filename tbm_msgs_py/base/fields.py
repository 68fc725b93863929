"""The base of models of files, and the numbers in them."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat


class FrozenModel(BaseModel):
    """Base of every section of a file: immutable, and a misspelt key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Positive = Annotated[PositiveFloat, Field(allow_inf_nan=False)]
