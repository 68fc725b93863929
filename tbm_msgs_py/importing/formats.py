"""Which suffix is which format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.importing.csv_file import CsvFile
from tbm_msgs_py.importing.description import Description
from tbm_msgs_py.importing.matlab_file import MatlabFile
from tbm_msgs_py.importing.mdf_file import MdfFile
from tbm_msgs_py.importing.source import Source
from tbm_msgs_py.importing.tdms_file import TdmsFile
from tbm_msgs_py.importing.wav_file import WavFile

_OPENERS: dict[str, Callable[[Path, Description], Source]] = {
    ".csv": lambda path, description: CsvFile(path, description.csv),
    ".txt": lambda path, description: CsvFile(path, description.csv),
    ".tdms": lambda path, _: TdmsFile(path),
    ".mf4": lambda path, _: MdfFile(path),
    ".wav": lambda path, _: WavFile(path),
    ".mat": lambda path, _: MatlabFile(path),
}


def open_source(path: Path, description: Description) -> Source:
    """Open a file of measurements by its suffix."""
    opener = _OPENERS.get(path.suffix.lower())
    if opener is None:
        raise RecordingError(f"{path}: suffix {path.suffix or 'missing'}, allowed: {', '.join(_OPENERS)}")
    if not path.is_file():
        raise RecordingError(f"{path}: no such file, allowed: a file of measurements")
    return opener(path, description)
