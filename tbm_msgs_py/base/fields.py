"""Types of the fields of files that people write: numbers, texts, and the base of their models."""

from typing import Annotated, ClassVar, Final

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    PositiveFloat,
    SerializerFunctionWrapHandler,
    model_serializer,
)

from tbm_msgs_py.base.texts import LONGEST_LINE, LONGEST_NAME


class FrozenModel(BaseModel):
    """Base of every section of a file: immutable, and a misspelt key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class SparseModel(FrozenModel):
    """Base of a section with `optional` keys that are not written while they have their default.

    A digest of what a file says is then the one from before there were such keys.
    """

    optional: ClassVar[tuple[str, ...]] = ()

    @model_serializer(mode="wrap")
    def _stated(self, dump: SerializerFunctionWrapHandler) -> dict[str, object]:
        data: dict[str, object] = dump(self)
        defaults = {key: type(self).model_fields[key].default for key in self.optional}
        return {key: value for key, value in data.items() if key not in defaults or getattr(self, key) != defaults[key]}


def _printable(text: str) -> str:
    """Text that a terminal, a picture and a page can show."""
    if not text.isprintable():
        raise ValueError("must be one line of printable characters")
    return text


NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Positive = Annotated[PositiveFloat, Field(allow_inf_nan=False)]
Vector3 = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Name = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME)]
Label = Annotated[Name, AfterValidator(_printable)]
Line = Annotated[str, Field(min_length=1, max_length=LONGEST_LINE), AfterValidator(_printable)]
Source = Line
"""Where a value is from: one of `SOURCES`, or the user's own words, as `drawing 4711, rev. B`."""

SOURCES: Final = ("table1", "table4", "table5", "assumed", "calibrated", "updated")
"""Sources with a meaning: tables of the paper, ours, fitted by the calibration, changed to explain a recording."""
