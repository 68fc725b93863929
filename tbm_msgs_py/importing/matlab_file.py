"""MATLAB `.mat` files: ``name`` for a vector, ``name(:,2)`` for a column of a matrix, ``part.name`` inside a struct."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tbm_msgs_py.importing.description import TimeBase, TimeColumn
from tbm_msgs_py.importing.measurement_file import MeasurementFile, Rows, library

_COLUMN = re.compile(r"(?P<name>[^()]+)\(:,\s*(?P<number>[1-9]\d*)\)")
_HDF5 = b"\x89HDF"


class MatlabFile(MeasurementFile):
    """A MATLAB file up to version 7.2 through scipy, and of version 7.3 (HDF5) through h5py."""

    kind = "a MATLAB"
    row_name = "row"
    clocks = ("column",)

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        with path.open("rb") as file:
            head = file.read(516)
        self._variables: dict[str, NDArray[np.generic]] = {}
        if head[:4] == _HDF5 or head[512:516] == _HDF5:
            self._read_hdf5()
        else:
            self._read_classic()

    def _pieces(self, columns: Sequence[str], time: TimeBase) -> Iterator[Rows]:
        clock = time if isinstance(time, TimeColumn) else None
        names = [*columns, *([clock.column] if clock else [])]
        return self.in_pieces(columns, [self._column(name) for name in names], clock)

    def _column(self, name: str) -> NDArray[np.generic]:
        part = _COLUMN.fullmatch(name)
        array = self._variables.get(part["name"].strip() if part else name)
        if array is None:
            raise self.no_column(name, sorted(self._variables))
        shape = " x ".join(map(str, array.shape))
        if part is None:
            if array.ndim == 2 and 1 in array.shape:
                return array.reshape(-1)
            if array.ndim == 2:
                raise self.error(
                    f"column {name}: a matrix of {shape}, allowed: one of its columns, such as {name}(:,1)"
                )
            return array
        number = int(part["number"])
        if array.ndim != 2 or number > array.shape[1]:
            raise self.error(f"column {name}: {part['name']} is {shape}, allowed: a column of it")
        return array[:, number - 1]

    def _read_classic(self) -> None:
        io: Any = library("scipy.io")
        with self.reading():
            found = io.loadmat(self.path, simplify_cells=True)
        self._variables.update(_flat({name: value for name, value in found.items() if not name.startswith("__")}))

    def _read_hdf5(self) -> None:
        """Read numeric data sets; MATLAB stores the columns of a matrix as rows."""
        h5py: Any = library("h5py")

        def add(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and item.dtype.kind in "iuf" and not name.startswith("#"):
                self._variables[name.replace("/", ".")] = item[()].T

        with self.reading(), h5py.File(self.path) as file:
            file.visititems(add)


def _flat(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, NDArray[np.generic]]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{name}.")
        elif isinstance(value, np.ndarray):
            yield f"{before}{name}", value
