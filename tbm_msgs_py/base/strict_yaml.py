"""YAML files of people: `1e9` is a number (not in YAML 1.1), a key `off` a word, a key given twice an error."""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterable
from pathlib import Path

import yaml

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.files import LARGEST_TEXT, read_text

# The C parser is five times faster, which a calibration notices; a few builds of PyYAML lack it.
_SafeLoader: type[yaml.SafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def read_yaml(
    path: str | Path,
    what: str,
    keys: Iterable[str] = (),
    error: type[InputError] = InputError,
    largest: int = LARGEST_TEXT,
) -> dict[str, object]:
    """Content of a YAML file.

    Parameters
    ----------
    path : str or Path
    what : str
        What the file holds, for messages.
    keys : iterable of str
        At least one of them is in the file; empty for any mapping.
    error : type
        Kind of error that is raised.
    largest : int
        Bytes that it may have.

    Raises
    ------
    InputError
        What is wrong, and where, without a word of the file: over ROS anybody may name one.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise error(f"{path}: no regular file, allowed: {what}")
    try:
        text = read_text(path, largest=largest)
    except OSError as problem:
        raise error(f"{path}: cannot be read ({problem.strerror}), allowed: {what}") from None
    except UnicodeDecodeError:
        raise error(f"{path}: not YAML (no UTF-8 text), allowed: {what}") from None
    return parse_yaml(text, str(path), what, keys, error)


def parse_yaml(
    text: str, label: str, what: str, keys: Iterable[str] = (), error: type[InputError] = InputError
) -> dict[str, object]:
    """Content of a YAML text, which messages call `label`; see `read_yaml`."""
    try:
        content = yaml.load(text, Loader=_Loader)  # noqa: S506 - a SafeLoader that also refuses repeated keys
    except yaml.MarkedYAMLError as problem:
        mark = problem.problem_mark or problem.context_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        found = problem.problem
        if mark and any(re.match(r" *\t", line) for line in text.split("\n")[mark.line : mark.line + 1]):
            found = "a tab, where lines begin with spaces"
        raise error(f"{label}: not YAML ({place}{found}), allowed: {what}") from None
    except yaml.YAMLError as problem:
        raise error(f"{label}: not YAML ({' '.join(str(problem).split())}), allowed: {what}") from None
    except RecursionError:
        raise error(f"{label}: not YAML (nested too deeply), allowed: {what}") from None
    except (ValueError, LookupError, TypeError, AttributeError) as problem:  # thousands of digits, a date that is none
        raise error(f"{label}: not YAML ({type(problem).__name__} at a value), allowed: {what}") from None
    keys = list(keys)
    if not isinstance(content, dict) or (keys and content.keys().isdisjoint(keys)):
        raise error(f"{label}: not {what}, allowed: a mapping{' with keys of ' * bool(keys)}{', '.join(keys)}")
    return content


_BOOL, _STR = "tag:yaml.org,2002:bool", "tag:yaml.org,2002:str"


class _Loader(_SafeLoader):  # type: ignore[valid-type, misc]  # chosen at run time
    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[object, object]:
        for key, _ in node.value:
            if key.tag == _BOOL:  # a key `off` is that word
                key.tag = _STR
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        seen: set[object] = set()
        for key in (key for key in keys if isinstance(key, Hashable)):  # yaml refuses the others
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key {key!r} is given twice", node.start_mark)
            seen.add(key)
        mapping: dict[object, object] = super().construct_mapping(node, deep)
        return mapping


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?[0-9][0-9_]*(\.[0-9]*)?[eE][-+]?[0-9]+$"), list("-+0123456789")
)
