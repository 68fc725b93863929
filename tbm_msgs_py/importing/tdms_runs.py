"""What a TDMS file states about its channels, and from which sample on: nptdms keeps the last statement only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

from tbm_msgs_py.importing.measurement_file import library

Properties: TypeAlias = Mapping[str, Any]


@dataclass(frozen=True)
class Statement:
    """Properties of an object as they hold from a sample on, which is counted from 0."""

    first: int
    properties: Properties


def read_statements(path: Path) -> dict[str, list[Statement]]:
    """Statements about each object of a file, by its path, in their order."""
    reader_module: Any = library("nptdms.reader")
    statements: dict[str, list[Statement]] = {}

    class SegmentReader(reader_module.TdmsReader):  # type: ignore[misc]  # nptdms has no types
        """Reader of metadata that says what every segment states."""

        rows: Mapping[str, int] = MappingProxyType({})

        def _update_object_properties(self, stated: Any) -> None:
            super()._update_object_properties(stated)
            for name in stated or ():
                properties = dict(self.object_metadata[name].properties)
                so_far = statements.setdefault(name, [])
                if not so_far or so_far[-1].properties != properties:
                    so_far.append(Statement(self.rows.get(name, 0), properties))
            self.rows = {name: found.num_values for name, found in self.object_metadata.items()}

    with path.open("rb") as file:
        SegmentReader(file).read_metadata()
    return statements
