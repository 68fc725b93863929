"""What the libraries of some formats warn of, collected instead of printed."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_IGNORED = (DeprecationWarning, PendingDeprecationWarning, FutureWarning, ResourceWarning, ImportWarning)
_LIBRARIES = ("nptdms", "asammdf", "canmatrix")


@contextmanager
def library_warnings(path: Path) -> Iterator[list[str]]:
    """Collect what libraries warn of, such as a file that ends too early, instead of printing it."""
    texts: list[str] = []
    listener = _WarningCollector(texts)
    logging.getLogger().addHandler(listener)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield texts
            texts += [str(warning.message) for warning in caught if not issubclass(warning.category, _IGNORED)]
            texts[:] = [f"{path}: {' '.join(text.split())}" for text in dict.fromkeys(texts)]
    finally:
        logging.getLogger().removeHandler(listener)


class _WarningCollector(logging.Handler):
    def __init__(self, texts: list[str]) -> None:
        super().__init__(logging.WARNING)
        self._texts = texts

    def emit(self, record: logging.LogRecord) -> None:
        """Add what one of the libraries logs."""
        if record.name.partition(".")[0] in _LIBRARIES:
            self._texts.append(record.getMessage())
