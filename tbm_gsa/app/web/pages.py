"""The pages of studies, explanations and comparisons that lie in a folder: found, named, and handed out by a key."""

from __future__ import annotations

import hashlib
import html
import os
import re
import stat
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from tbm_gsa.app.web.state import LinkedPage, PageList
from tbm_msgs_py.base.files import read_text
from tbm_msgs_py.base.units import iso_time

MOST: Final = 20
"""The newest pages that are shown."""
_DEPTH: Final = 3  # folders below
_LARGEST: Final = 64 << 20  # bytes
_HEAD: Final = 8192  # bytes in which the title stands
_TITLE: Final = re.compile(r"<title>(.{1,200}?)</title>", re.DOTALL)


class PageFolder:
    """Pages below a folder; links lead nowhere.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def find(self) -> PageList:
        """Newest pages."""
        found = sorted(self._files(), reverse=True)
        return PageList(pages=tuple(self._linked(file, written_ns) for written_ns, file in found[:MOST]))

    def read(self, key: str) -> str | None:
        """Content of a page; None of one that is not there."""
        file = next((file for _, file in self._files() if _key(file) == key), None)
        if file is None:
            return None
        try:
            return read_text(file, largest=_LARGEST)
        except (OSError, UnicodeDecodeError):  # gone by now, or no page
            return None

    def _files(self) -> Iterator[tuple[int, Path]]:
        """Time of writing (ns) and path of every page."""
        base = len(self._folder.parts)
        for folder, inner, files in os.walk(self._folder):  # it follows no links
            if len(Path(folder).parts) - base >= _DEPTH:
                inner.clear()
            for name in sorted(files):
                file = Path(folder, name)
                if file.suffix != ".html":
                    continue
                with suppress(OSError):  # gone by now
                    found = file.lstat()
                    if stat.S_ISREG(found.st_mode):
                        yield found.st_mtime_ns, file

    def _linked(self, file: Path, written_ns: int) -> LinkedPage:
        head = ""
        with suppress(OSError), file.open("rb") as opened:
            head = opened.read(_HEAD).decode(errors="replace")
        found = _TITLE.search(head)
        title = " ".join(html.unescape(found[1]).split()) if found else file.stem
        return LinkedPage(
            key=_key(file), title=title, file=str(file.relative_to(self._folder)), written=iso_time(written_ns)
        )


def _key(file: Path) -> str:
    return hashlib.sha256(os.fsencode(file)).hexdigest()[:16]
