"""MATLAB `.mat` files: ``name`` for a vector, ``name(:,2)`` for a column of a matrix, ``part.name`` inside a struct."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.importing.description import TimeColumn
from tbm_msgs_py.importing.extra import library, reading
from tbm_msgs_py.importing.source import Piece, array_pieces, nanoseconds, no_column, no_time_of_its_own

_COLUMN = re.compile(r"(?P<name>[^()]+)\(:,\s*(?P<number>[1-9]\d*)\)")
_HDF5 = b"\x89HDF"


class MatlabFile:
    """A MATLAB file up to version 7.2 through scipy, and of version 7.3 (HDF5) through h5py."""

    shared_rows = True
    start_ns = None
    full_scale = False

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open("rb") as file:
            head = file.read(516)
        newer = head[:4] == _HDF5 or head[512:516] == _HDF5
        self._variables = _read_hdf5(path) if newer else _read_classic(path)

    def row(self, index: int) -> str:
        """Name a row for a message."""
        return f"row {index + 1}"

    def unit(self, column: str) -> str:  # noqa: ARG002
        """Give no unit: a MATLAB file states none."""
        return ""

    def pieces(self, columns: Sequence[str], time: TimeColumn | str | None) -> Iterator[Piece]:
        """Rows of these columns, see `Source`."""
        if isinstance(time, str):
            no_time_of_its_own(self.path, "a MATLAB file")
        arrays = [self._column(column) for column in columns]
        times = None
        if time:
            if time.unit == "datetime":
                raise RecordingError(f"{self.path}: time: unit datetime, allowed: s, ms, us or ns in a MATLAB file")
            clock = self._column(time.column)
            for _ in array_pieces(self.path, [time.column], [clock], None):
                pass  # refuses what is no number
            times = nanoseconds(clock, time.unit)
        yield from array_pieces(self.path, columns, arrays, times)

    def _column(self, name: str) -> NDArray[np.generic]:
        part = _COLUMN.fullmatch(name)
        array = self._variables.get(part["name"].strip() if part else name)
        if array is None:
            no_column(self.path, name, sorted(self._variables))
        if part is None:
            if array.ndim == 2 and 1 in array.shape:
                return array.reshape(-1)
            if array.ndim == 2:
                raise RecordingError(
                    f"{self.path}: column {name}: a matrix of {array.shape[0]} x {array.shape[1]}, "
                    f"allowed: one of its columns, such as {name}(:,1)"
                )
            return array
        number = int(part["number"])
        if array.ndim != 2 or number > array.shape[1]:
            shape = " x ".join(map(str, array.shape))
            raise RecordingError(f"{self.path}: column {name}: {part['name']} is {shape}, allowed: a column of it")
        return array[:, number - 1]


def _read_classic(path: Path) -> dict[str, NDArray[np.generic]]:
    io: Any = library("scipy.io")
    with reading(path, "a MATLAB"):
        found = io.loadmat(path, simplify_cells=True)
    return dict(_flat({name: value for name, value in found.items() if not name.startswith("__")}))


def _read_hdf5(path: Path) -> dict[str, NDArray[np.generic]]:
    """Read numeric data sets; MATLAB stores the columns of a matrix as rows."""
    h5py: Any = library("h5py")
    variables: dict[str, NDArray[np.generic]] = {}

    def take(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "iuf" and not name.startswith("#"):
            variables[name.replace("/", ".")] = item[()].T

    with reading(path, "a MATLAB"), h5py.File(path) as file:
        file.visititems(take)
    return variables


def _flat(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, NDArray[np.generic]]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{name}.")
        elif isinstance(value, np.ndarray):
            yield f"{before}{name}", value
