"""Curves kept on disk, so that the next explanation of a machine is ready at once."""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
import zlib
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Final

import numpy as np

from tbm_dynamics import Machine, MachineError
from tbm_gsa.explanation.band_reading import BandReading
from tbm_gsa.explanation.cause_curves import WORKERS, CauseCurves, CurveTable, cause_curves
from tbm_gsa.explanation.load_scatter import LoadScatter
from tbm_gsa.explanation.load_transfer import LoadTransfer
from tbm_gsa.explanation.ranges import explaining_inputs
from tbm_gsa.provenance import package_versions
from tbm_msgs_py.base.files import write_whole
from tbm_msgs_py.base.progress import CountDone

FORMAT: Final = 2
"""Raised with whatever changes what the curves of a machine are."""
KEPT: Final = 16
"""Files of 2 MB; the oldest goes."""
_DAMAGED: Final = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error)
_TABLE: Final = ("unit", "gain", "modulated", "meshes", "spread")
_SPEED_DIGITS: Final = 3
_LOAD_DIGITS: Final = 2
_SCATTER: Final = ("falling", "staying", "width")
_TRANSFER: Final = ("gain", "modulated", "meshes")


def cache_folder() -> Path:
    """``tbm_monitor/curves`` in the user's cache folder (``$XDG_CACHE_HOME``)."""
    given = os.environ.get("XDG_CACHE_HOME")
    return (Path(given) if given else Path(os.path.expanduser("~/.cache"))) / "tbm_monitor" / "curves"  # noqa: PTH111


def at_operating_point(machine: Machine, speed_r_min: float, torque_kn_m: float, thrust_kn: float) -> Machine:
    """Machine at an operating point, rounded: times that differ by less share their curves.

    The loads' level is free all the same.
    """
    with suppress(MachineError):
        return machine.with_inputs(
            x1=rounded(speed_r_min, _SPEED_DIGITS),
            x2=rounded(torque_kn_m, _LOAD_DIGITS),
            x3=rounded(thrust_kn, _LOAD_DIGITS),
        )
    return machine.with_inputs(x1=speed_r_min, x2=torque_kn_m, x3=thrust_kn)  # rounded it is beyond the limits


def rounded(value: float, digits: int) -> float:
    """Value with so many significant digits."""
    return float(f"{value:.{digits}g}")


def kept_curves(machine: Machine, reading: BandReading) -> CauseCurves | None:
    """Curves of a machine at its operating point and a reading, if they are on the disk, whole."""
    with suppress(*_DAMAGED):
        return _read(_file(machine, reading), machine, reading)
    return None


def cached_curves(
    machine: Machine, reading: BandReading, workers: int = WORKERS, progress: CountDone = lambda *_: None
) -> CauseCurves:
    """Curves of a machine at its operating point and a reading, from the disk if they are there whole.

    Where the folder cannot be written they are computed each time. Parameters as those of `cause_curves`.
    """
    kept = kept_curves(machine, reading)
    if kept is not None:
        return kept
    found = cause_curves(machine, reading, workers, progress)
    path = _file(machine, reading)
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, _written(found))
        for old in sorted(path.parent.glob("*.npz"), key=lambda one: one.stat().st_mtime)[:-KEPT]:
            old.unlink()
    return found


def _file(machine: Machine, reading: BandReading) -> Path:
    """File named by a digest of all that the curves come from."""
    parts = {
        "format": FORMAT,
        "machine": machine.description.model_dump_json(),
        "reading": {
            "sensors": {point: asdict(sensor) for point, sensor in reading.sensors.items()},
            "numbers": (reading.bands, reading.rate_hz, asdict(reading.band), reading.segment_s),
        },
        "version": package_versions().get("tbm_monitor", "source"),
    }
    return cache_folder() / f"{hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:32]}.npz"


def _written(curves: CauseCurves) -> bytes:
    arrays = {f"nominal/{name}": getattr(curves.nominal, name) for name in _SCATTER}
    arrays |= {f"transfer/{name}": getattr(curves.nominal.transfer, name) for name in _TRANSFER}
    for code, table in curves.tables.items():
        arrays |= {f"{code}/{name}": getattr(table, name) for name in _TABLE}
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def _read(path: Path, machine: Machine, reading: BandReading) -> CauseCurves:
    """Curves of a file, each part of which has a checksum; an error of `_DAMAGED` if it is not whole."""
    inputs, statistics = explaining_inputs(machine), reading.statistics
    with np.load(path, allow_pickle=False) as file:
        transfer = LoadTransfer(statistics, **{name: file[f"transfer/{name}"] for name in _TRANSFER})
        nominal = LoadScatter(
            transfer, **{name: file[f"nominal/{name}"] for name in _SCATTER}, segment_s=reading.segment_s
        )
        tables = {
            item.code: CurveTable(**{name: file[f"{item.code}/{name}"] for name in _TABLE}) for item in inputs.inputs
        }
    return CauseCurves(inputs, nominal, tables)
