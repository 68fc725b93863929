"""Libraries that the import of some formats needs: found or named, their errors and complaints in one line each."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import ModuleType

from tbm_msgs_py.base.errors import RecordingError

EXTRA = "import"
_TALKATIVE = ("nptdms", "asammdf", "canmatrix")


def library(name: str) -> ModuleType:
    """Import a library by name; where it is missing, say in one line what installs it."""
    try:
        return import_module(name)
    except ImportError as error:
        raise RecordingError(
            f"{name.partition('.')[0]} is not installed ({error}), allowed: a format that does not need it, "
            f"or this one after pip install 'tbm_monitor[{EXTRA}]'"
        ) from error


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Say in one line what a library finds wrong with a file; on a damaged one they raise whatever there is."""
    try:
        yield
    except RecordingError:
        raise
    except Exception as error:
        why = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(
            f"{path}: not {kind} file that can be read ({why}), allowed: one that is not damaged"
        ) from error


@contextmanager
def complaints(path: Path) -> Iterator[list[str]]:
    """Collect what libraries warn of, such as a file that ends too early, instead of printing it."""
    said: list[str] = []
    listener = _Listener(said)
    logging.getLogger().addHandler(listener)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield said
            said += [str(warning.message) for warning in caught if not issubclass(warning.category, _OF_NO_INTEREST)]
            said[:] = [f"{path}: {' '.join(text.split())}" for text in dict.fromkeys(said)]
    finally:
        logging.getLogger().removeHandler(listener)


_OF_NO_INTEREST = (DeprecationWarning, PendingDeprecationWarning, FutureWarning, ResourceWarning, ImportWarning)


class _Listener(logging.Handler):
    def __init__(self, said: list[str]) -> None:
        super().__init__(logging.WARNING)
        self._said = said

    def emit(self, record: logging.LogRecord) -> None:
        """Take down what one of the libraries logs."""
        if record.name.partition(".")[0] in _TALKATIVE:
            self._said.append(record.getMessage())
