"""The pages of the project, and the examples and commands that stand in them."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
MADE = {"command_line.md", "parameters.md", "schemas.md"}  # from the code, when the documentation is built
PAGES = sorted(
    [
        *(page for page in (ROOT / "docs").rglob("*.md") if page.name not in MADE),
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
    ]
)

_FENCE = re.compile(r"^( *)```(\w+) ?([^\n]*)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
_CODE_LINE = re.compile(r"^(?: {3,4}|\$ )+(tbm-monitor .*)$", re.MULTILINE)
_CODE_SPAN = re.compile(r"`(tbm-monitor [^`]*)`")
_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")


@dataclass(frozen=True)
class Example:
    """A fenced block: its language, the words behind it (`run`, `verify`), its text."""

    language: str
    words: frozenset[str]
    text: str
    line: int

    def commands(self) -> Iterator[tuple[str, str]]:
        """Each command of a console block, and what it prints; empty where the page does not show it."""
        for part in re.split(r"^\$ ", self.text, flags=re.MULTILINE)[1:]:
            command, _, printed = part.partition("\n")
            yield command, printed.strip()


def examples(page: Path) -> list[Example]:
    """Every fenced block of a page."""
    text = page.read_text(encoding="utf-8")
    return [
        Example(found[2], frozenset(found[3].split()), textwrap.dedent(found[4]), text[: found.start()].count("\n") + 1)
        for found in _FENCE.finditer(text)
    ]


def named_commands(page: Path) -> list[str]:
    """Every command line that a page shows, comments left out."""
    text = page.read_text(encoding="utf-8")
    shown = [*_CODE_LINE.findall(text), *_CODE_SPAN.findall(text)]
    return [re.split(r" #| >|\n", command)[0].replace("`", "").strip() for command in shown]


def agrees(shown: str, printed: str, tolerance: float = 0.05) -> bool:
    """Whether a command prints what its page shows: words alike, numbers nearly, `...` for anything."""
    pattern, numbers, place = [], [], 0
    for found in re.finditer(rf"\.\.\.|\s+|{_NUMBER.pattern}", shown):
        pattern.append(re.escape(shown[place : found.start()]))
        token, place = found[0], found.end()
        if token == "...":
            pattern.append(".*?")
        elif token.isspace():
            pattern.append(r"\s+")
        else:
            pattern.append(f"({_NUMBER.pattern})")
            numbers.append(float(token))
    pattern.append(re.escape(shown[place:]))
    match = re.fullmatch("".join(pattern), printed.strip(), re.DOTALL)
    return match is not None and all(
        abs(float(value) - wanted) <= tolerance * abs(wanted) + 0.011
        for value, wanted in zip(match.groups(), numbers, strict=True)
    )
