"""How files write the units that a description knows."""

from __future__ import annotations

_SPELLINGS = {
    "m/s2": ("m/s2", "m/s/s", "m.s-2"),
    "g": ("g", "gn", "g_n"),
    "N": ("N",),
    "kN": ("kN",),
    "MN": ("MN",),
    "N.m": ("N.m",),
    "kN.m": ("kN.m",),
    "MN.m": ("MN.m", "MNM"),
    "rad/s": ("rad/s", "rad.s-1"),
    "r/min": ("r/min", "rpm", "rev/min", "1/min", "min-1", "U/min"),
    "m/s": ("m/s", "m.s-1"),
    "mm/min": ("mm/min", "mm.min-1"),
}
_SIGNS = str.maketrans({"²": "2", "¹": "1", **dict.fromkeys(" .·⋅∙*-⁻^", "")})


def same_unit(label: str, unit: str) -> bool:
    """Whether what a file states means a unit of a description; the sign of a product and of a power is no matter."""
    return _plain(label) in {_plain(spelling) for spelling in _SPELLINGS[unit]}


def _plain(label: str) -> str:
    """Without signs and in small letters, but for mega: mN is not MN."""
    plain = label.translate(_SIGNS)
    return plain if plain.startswith("MN") else plain.lower()
