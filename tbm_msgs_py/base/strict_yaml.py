"""YAML as people mean it: `1e9` is a number (YAML 1.1 asks for `1.0e+9`), a key given twice is an error."""

from __future__ import annotations

import re
from collections.abc import Hashable

import yaml

# The C parser is five times faster, which a calibration notices; a few builds of PyYAML lack it.
_SafeLoader: type[yaml.SafeLoader] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def strict_yaml(text: str) -> object:
    """Parse a document; raises yaml.YAMLError."""
    try:
        return yaml.load(text, Loader=_Loader)  # noqa: S506 - a SafeLoader that also refuses repeated keys
    except RecursionError:
        raise yaml.YAMLError("nested too deeply") from None
    except ValueError as error:  # a number of thousands of digits, a date that is none
        raise yaml.YAMLError(str(error)) from None


def yaml_problem(error: Exception) -> str:
    """Say what is wrong with a text that is no YAML, and where, without quoting it: it may be anybody's file."""
    mark = getattr(error, "problem_mark", None)
    if mark is None:
        return " ".join(str(error).split())
    return f"line {mark.line + 1}, column {mark.column + 1}: {getattr(error, 'problem', '')}"


class _Loader(_SafeLoader):  # type: ignore[valid-type, misc]  # chosen at run time
    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[object, object]:
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
