"""What a CSV file seems to be like where it is not as described: for messages only, nothing is read by it."""

from __future__ import annotations

import csv
import json
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC
from itertools import islice
from pathlib import Path
from typing import Final

from tbm_msgs_py.base.texts import number_reader
from tbm_msgs_py.importing.layout import THOUSANDS, CsvLayout
from tbm_msgs_py.importing.moments import moment_ns

_LINES: Final = 100  # of the beginning that are looked through
_LONGEST: Final = 1 << 16  # characters of one of them
_DELIMITERS: Final = (",", ";", "\t", "|", " ")
_ENCODINGS: Final = ("utf-8-sig", "utf-16", "cp1252")
_BYTE_ORDER_MARKS: Final = (b"\xff\xfe", b"\xfe\xff")
_ZIP: Final = b"PK\x03\x04"


def of_columns(path: Path, columns: Sequence[str], layout: CsvLayout) -> str:
    """Keys by which the file has columns that it does not have as described; empty where it has them by none."""
    if not layout.header:
        return ""
    delimiters = tuple(dict.fromkeys((layout.delimiter, *_DELIMITERS)))
    for encoding in dict.fromkeys((layout.encoding, *_ENCODINGS)) if not any(map(_is_value, columns)) else ():
        for number, line in enumerate(_lines(path, encoding), start=1):
            for delimiter in delimiters:
                if set(columns) <= set(_cells(line, delimiter)):
                    return "; it is there by " + _keys(layout, header=number, delimiter=delimiter, encoding=encoding)
    line = next(islice(_lines(path, layout.encoding), layout.header - 1, None), "")
    if any(all(map(_is_value, cells)) for cells in (_cells(line, delimiter) for delimiter in delimiters) if cells):
        return (
            f"; line {layout.header} holds numbers, no names: csv: {{header: 0}} says that there are none, and columns "
            "are called 1, 2, …"
        )
    return ""


def of_number(cell: str, layout: CsvLayout) -> str:
    """Keys by which a cell is a number that it is not as described; empty where it is one by none."""
    signs = [(decimal, thousands) for thousands in (None, *THOUSANDS) for decimal in (".", ",")]
    found = {
        _keys(layout, decimal=decimal, thousands=thousands): (decimal != layout.decimal)
        + (thousands != layout.thousands)
        for decimal, thousands in signs
        if decimal not in (thousands, layout.delimiter) and number_reader(decimal, thousands)(cell) is not None
    }
    plain = unicodedata.normalize("NFKC", cell).replace("\u2212", "-")
    if not found and plain != cell and number_reader(layout.decimal, layout.thousands)(plain) is not None:
        odd = next(sign for sign in cell if not sign.isascii())
        return f"; {odd!r} is {unicodedata.name(odd, 'no sign')}, which is no part of a plain number"
    fewest = min(found.values(), default=0)
    return "".join(["; it is one by " + " or ".join(key for key in found if found[key] == fewest)] if found else [])


def of_first_row(lines: Iterable[str], column: int, layout: CsvLayout) -> str:
    """Key for lines such as that of units between names and numbers, if the first of these lines is one."""
    rows = [_cells(line, layout.delimiter) for line in islice(lines, _LINES)]
    if any(map(_is_value, rows[0])):
        return ""
    for number, row in enumerate(rows, start=layout.first_line):
        if column < len(row) and _is_value(row[column]):
            key = {"first": number} if layout.header else {"header": number - 1}
            return f"; numbers begin in line {number}: " + _keys(layout, **key)
    return ""


def of_width(cells: Sequence[str], delimiter: str) -> str:
    """Say that decimal commas cannot be told from commas between cells, if these cells look like that."""
    if delimiter == "," and all(cell.strip().lstrip("+-").isdigit() for cell in cells):
        return "; numbers with decimal commas need another delimiter in the file"
    return ""


def of_encoding(path: Path, layout: CsvLayout) -> str:
    """Say which encoding the file may have where it does not have the one described."""
    with path.open("rb") as file:
        head = file.read(_LONGEST)
    if head.startswith(_ZIP):
        return "; it is a zip archive, as .xlsx files are: export it as CSV"
    if head.startswith(_BYTE_ORDER_MARKS):
        return "; it begins as UTF-16 does: " + _keys(layout, encoding="utf-16")
    if b"\0" in head:
        return "; it holds zero bytes, as no text but UTF-16 does"
    return "; files of Windows often have " + _keys(layout, encoding="cp1252")


def _keys(layout: CsvLayout, **keys: object) -> str:
    """Keys of the description whose values are not those that it has."""
    changed = [
        f"{key}: {json.dumps(value, ensure_ascii=False)}"
        for key, value in keys.items()
        if value != getattr(layout, key)
    ]
    return f"csv: {{{', '.join(changed)}}}"


def _lines(path: Path, encoding: str) -> Iterator[str]:
    """First lines, as far as they can be decoded."""
    try:
        with path.open(encoding=encoding, newline="") as file:
            for _ in range(_LINES):
                if not (line := file.readline(_LONGEST)):
                    return
                yield line.removeprefix("\ufeff")
    except (ValueError, LookupError):
        return


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:
        return []


def _is_value(cell: str) -> bool:
    """Whether a cell is a number in any format, or a date."""
    if any(number_reader(decimal)(cell) is not None for decimal in (".", ",")):
        return True
    try:
        moment_ns(cell.strip(), UTC)
    except (ValueError, OverflowError):
        return False
    return True
