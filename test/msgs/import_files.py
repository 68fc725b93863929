"""Files of other systems, their descriptions, and what an import of them has to give."""

import csv
import math

import numpy as np
import pytest

from tbm_msgs_py import OperatingPoint, RecordingError
from tbm_msgs_py.importing import describe, import_recording

START = "2026-03-01T08:00:00+01:00"
START_NS = 1_772_348_400_000_000_000  # date -d
RATE, ROWS = 1000, 1700
TIME = np.arange(ROWS) / RATE
VALUES = np.random.default_rng(7).normal(size=(ROWS, 3))
POINT = {"columns": ["ax", "ay", "az"], "units": "m/s2", "gravity": "removed", "frame": "fixed"}
OPERATING = {
    "speed": {"column": "rpm", "unit": "r/min"},
    "torque": {"column": "torque", "unit": "kN.m"},
    "thrust": {"column": "thrust", "unit": "kN"},
}
SLOW_POINT = OperatingPoint(7 * (2 * math.pi / 60), 20e3, 12e6)
TOPIC = "/tbm/field/shield/block"


def description(**changes):
    return describe(None, {"points": {"shield": POINT}, "rate": RATE, "start": START} | changes)


def without(key, **changes):
    return describe(None, {k: v for k, v in ({"rate": RATE, "start": START} | changes).items() if k != key})


def write_csv(path, columns, delimiter=",", text=repr):
    with path.open("w", newline="") as file:
        writer = csv.writer(file, delimiter=delimiter)
        writer.writerow(columns)
        writer.writerows([[text(float(value)) for value in row] for row in zip(*columns.values(), strict=True)])
    return path


def columns(**more):
    return {"t": TIME, "ax": VALUES[:, 0], "ay": VALUES[:, 1], "az": VALUES[:, 2], **more}


def check(record, time=TIME, values=VALUES, ulp=0):
    assert record.start_ns == START_NS + round(time[0] * 1e9)
    np.testing.assert_allclose(record.time, time - time[0], rtol=0, atol=1e-9)
    np.testing.assert_array_max_ulp(record.values.astype(np.float32), values.astype(np.float32), ulp)


def refused(path, described, out):
    with pytest.raises(RecordingError) as caught:
        import_recording(path, described, out)
    assert not out.exists()
    assert [file for file in out.parent.iterdir() if file.name.startswith(".")] == []
    assert "\n" not in str(caught.value)
    assert "allowed: " in str(caught.value)
    return str(caught.value)


def write_hdf5(path, content):
    """As MATLAB writes version 7.3: a user block of 512 bytes, columns as rows."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in content.items():
            if isinstance(value, dict):
                for key, inner in value.items():
                    file[f"{name}/{key}"] = np.atleast_2d(inner)
            else:
                file[name] = np.atleast_2d(value) if value.ndim == 1 else value.T
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
