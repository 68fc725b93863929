"""Every key of a document, tampered with in every way."""

import copy

REMOVED = object()
WRONG = {
    "removed": REMOVED,
    "null": None,
    "a text": "x",
    "a long text": "x" * 100_000,
    "a number": 7,
    "a negative number": -1.5,
    "huge": 1e300,
    "huge and whole": 10**400,
    "not a number": float("nan"),
    "infinite": float("inf"),
    "true": True,
    "nested": [[[]]],
    "a mapping": {"x": {}},
    "deep": None,  # filled in below
}


def _deep(levels):
    found = []
    for _ in range(levels):
        found = [found]
    return found


WRONG["deep"] = _deep(50)


def places(document, place=()):
    """Paths of all values of a document, those of mappings and lists too."""
    if place:
        yield place
    if isinstance(document, dict):
        for key, value in document.items():
            yield from places(value, (*place, key))
    if isinstance(document, list):
        for number, value in enumerate(document):
            yield from places(value, (*place, number))


def tampered(document, place, wrong):
    """A copy with another value at a place, or none."""
    copied = copy.deepcopy(document)
    *parents, last = place
    entry = copied
    for key in parents:
        entry = entry[key]
    if wrong is REMOVED:
        del entry[last]
    else:
        entry[last] = wrong
    return copied
