"""Table 5: coupling stiffness along x, y, z (N/m) and about x, y, z (N·m/rad)."""

from typing import Final

Six = tuple[float, float, float, float, float, float]

_BOLTED: Final[Six] = (1e10, 5e9, 5e9, 1e10, 5e10, 5e10)
_BEARING: Final[Six] = (1e10, 1e9, 1e9, 0.0, 1e10, 1e10)

TABLE_5: Final[dict[str, Six]] = {
    "k_r_ct": (1e9, 1e9, 1e9, 1e9, 1e9, 1e9),
    "k_r_gd": _BOLTED,
    "k_c_cf": _BOLTED,
    "k_c_fb": _BOLTED,
    "k_c_bc": _BOLTED,
    "k_c_cg": _BOLTED,
    "k_b_io": _BEARING,
    "k_b_pc": _BEARING,
    "k_s_pg": _BOLTED,
    "k_h_gd": _BOLTED,
}
