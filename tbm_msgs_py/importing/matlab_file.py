"""MATLAB `.mat` files: ``name`` for a vector, ``name(:,2)`` or ``name(2,:)`` in a matrix, ``part.name`` in a struct."""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tbm_msgs_py.base.texts import listed
from tbm_msgs_py.importing.layout import FileLayout, TimeBase, TimeColumn
from tbm_msgs_py.importing.measurement_file import MeasurementFile, Rows, library

_PART: Final = re.compile(r"(?P<name>[^()]+)\((?::,\s*(?P<column>[1-9]\d*)|(?P<row>[1-9]\d*),\s*:)\)")
_HDF5: Final = b"\x89HDF"
_NUMERIC: Final = {"double", "single", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}
_KINDS: Final = {"b": "logical", "c": "complex", "U": "char", "S": "char", "O": "cell, struct array or text"}


_Found: TypeAlias = tuple[str, Callable[[], NDArray[Any]]]
"""Class of a variable, empty for real numbers, and what reads them."""


class MatlabFile(MeasurementFile):
    """A MATLAB file up to version 7.2 through scipy, and of version 7.3 (HDF5) through h5py."""

    kind = "a MATLAB"
    row_name = "row"
    clocks = ("column",)

    def __init__(self, path: Path, layout: FileLayout) -> None:
        super().__init__(path, layout)
        with path.open("rb") as file:
            head = file.read(516)
        hdf5 = _HDF5 in (head[:4], head[512:516])
        found = self._read_hdf5() if hdf5 else self._read_classic()
        self._variables: dict[str, _Found] = {}
        for name, variable in found:
            if name in self._variables:
                raise self.error(f"variable {name} is there twice, allowed: once")
            self._variables[name] = variable

    def _pieces(self, columns: Sequence[str], time: TimeBase) -> Iterator[Rows]:
        clock = time if isinstance(time, TimeColumn) else None
        names = [*columns, *([clock.column] if clock else [])]
        return self.in_pieces(columns, [self._column(name) for name in names], clock)

    def _column(self, name: str) -> NDArray[np.generic]:
        part = _PART.fullmatch(name)
        variable = part["name"].strip() if part else name
        array = self._numbers(variable)
        shape = " x ".join(map(str, array.shape))
        if part is None:
            if array.ndim == 2 and 1 in array.shape:
                return array.reshape(-1)
            if array.ndim == 2:
                raise self.error(
                    f"column {name}: a matrix of {shape}, allowed: one of its columns, such as {name}(:,1), "
                    f"or of its rows, such as {name}(1,:)"
                )
            return array
        axis, number = (1, int(part["column"])) if part["column"] else (0, int(part["row"]))
        if array.ndim != 2 or number > array.shape[axis]:
            raise self.error(f"column {name}: {variable} is {shape}, allowed: a column or a row of it")
        return np.asarray(array.take(number - 1, axis))

    def _numbers(self, variable: str) -> NDArray[Any]:
        if variable not in self._variables:
            raise self.no_column(variable, sorted(self._variables))
        kind, read = self._variables[variable]
        if kind:
            raise self.error(f"column {variable}: class {kind}, allowed: real numbers ({listed(sorted(_NUMERIC))})")
        with self.reading():
            return read()

    def _read_classic(self) -> Iterator[tuple[str, _Found]]:
        io: Any = library("scipy.io")
        with self.reading():
            twice = [name for name, count in Counter(row[0] for row in io.whosmat(self.path)).items() if count > 1]
            if twice:
                raise self.error(f"variable {twice[0]} is there twice, allowed: once")
            # Twice: with its classes scipy would drop the imaginary part, without them logical values are numbers.
            with warnings.catch_warnings(action="ignore", category=np.exceptions.ComplexWarning):
                classes = {
                    name: _class_of(value)
                    for name, value in _flat(io.loadmat(self.path, mat_dtype=True, struct_as_record=False))
                }
            content = list(_flat(io.loadmat(self.path, struct_as_record=False)))
        for name, value in content:
            yield name, (_class_of(value) or classes[name], partial(np.asarray, value))

    def _read_hdf5(self) -> Iterator[tuple[str, _Found]]:
        h5py: Any = library("h5py")
        with self.reading():
            found: list[tuple[str, _Found]] = []
            _visit(h5py.File(self.path), "", found, h5py)
        return iter(found)


def _flat(values: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Variables of a classic file, and those inside structs."""
    for name, value in ((name, value) for name, value in values.items() if before or not name.startswith("__")):
        only: Any = value.flat[0] if isinstance(value, np.ndarray) and value.size == 1 else None
        if hasattr(only, "_fieldnames"):
            yield from _flat({key: getattr(only, key) for key in only._fieldnames}, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def _class_of(value: Any) -> str:
    """Class of a variable of a classic file, empty for real numbers."""
    if type(value) is np.ndarray:
        return "" if value.dtype.kind in "iuf" else _KINDS.get(value.dtype.kind, str(value.dtype))
    names = {"MatlabFunction": "function handle", "MatlabOpaque": "object, such as a datetime or a string"}
    return names.get(type(value).__name__, "sparse" if hasattr(value, "tocoo") else type(value).__name__)


def _visit(group: Any, before: str, found: list[tuple[str, _Found]], h5py: Any) -> None:
    """Add the variables of a group of a file of version 7.3, and those inside structs."""
    for name in group:
        link = group.get(name, getlink=True)
        if name.startswith("#") or not isinstance(link, h5py.HardLink):
            continue
        item = group[name]
        kind = _text(item.attrs.get("MATLAB_class", ""))
        if isinstance(item, h5py.Group) and kind in ("", "struct") and "MATLAB_sparse" not in item.attrs:
            _visit(item, f"{before}{name}.", found, h5py)
        elif isinstance(item, h5py.Group):
            found.append((f"{before}{name}", ("sparse" if "MATLAB_sparse" in item.attrs else kind, _nothing)))
        elif isinstance(item, h5py.Dataset):
            found.append((f"{before}{name}", (_class_of_dataset(item, kind, h5py), partial(_read, item))))


def _class_of_dataset(item: Any, kind: str, h5py: Any) -> str:
    """Class of a data set, empty for real numbers: MATLAB stores text, logical values and objects as numbers too."""
    if item.dtype.kind not in "iuf" or h5py.check_enum_dtype(item.dtype):
        if item.dtype.names:
            return "complex" if set(item.dtype.names) == {"real", "imag"} else "compound"
        return kind or _KINDS.get(item.dtype.kind, str(item.dtype))
    if "MATLAB_object_decode" in item.attrs or (kind and kind not in _NUMERIC):
        return kind or "object"
    return ""


def _read(item: Any) -> NDArray[np.generic]:
    """Numbers of a data set; the columns of a matrix are stored as rows, the shape of an empty one as its content."""
    if item.attrs.get("MATLAB_empty", 0) or not item.size:
        return np.empty(0)
    if not item.id.get_storage_size():
        raise ValueError("a data set that was never written")
    return np.atleast_1d(item[()]).T


def _nothing() -> NDArray[np.generic]:
    return np.empty(0)


def _text(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes) else str(value)
