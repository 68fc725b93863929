"""Curves of band powers along the inputs: against machines with that input, and on disk.

Source: `load_transfer` and `load_scatter` of the varied machine, which are held against runs elsewhere.
"""

import numpy as np
import pytest

from tbm_gsa.explanation import cause_curves as module
from tbm_gsa.explanation import curve_cache
from tbm_gsa.explanation.band_reading import BandReading, Sensor
from tbm_gsa.explanation.cause_curves import cause_curves
from tbm_gsa.explanation.curve_cache import cache_folder, cached_curves
from tbm_gsa.explanation.load_scatter import load_scatter
from tbm_gsa.explanation.load_transfer import machine_motion
from tbm_gsa.explanation.machine_state import CauseGrid
from tbm_gsa.explanation.ranges import explaining_inputs
from tbm_gsa.sensitivity.study.distributions import LogUniform
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_msgs_py.base.errors import InputError

READING = BandReading({"cutterhead": Sensor(), "girder": Sensor()}, bands=((0.5, 20.0), (125.0, 135.0)))


@pytest.fixture(autouse=True)
def one_input(monkeypatch, tmp_path):
    """One input at three values, and a cache of its own."""
    few = lambda machine: InputSet(tuple(one for one in explaining_inputs(machine).inputs if one.code == "x16"))  # noqa: E731
    for where in (module, curve_cache):
        monkeypatch.setattr(where, "explaining_inputs", few)
    monkeypatch.setattr(module, "CELLS", {LogUniform: 2})
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def test_curves_pass_through_the_machines_of_their_values(machine):
    curves = cause_curves(machine, READING, workers=1)
    assert curves.tables["x16"].unit == pytest.approx([0.0, 0.5, 1.0])
    noise, factors = np.full(len(READING.statistics), 1e-6), np.array([2.0, 0.6, 1.0, 1.0, 0.7, 1.5])
    for value in (1.0, 3.0):
        exact = load_scatter(machine_motion(machine.with_inputs(x16=value), READING))
        found = curves.at("x16", value)
        np.testing.assert_allclose(found.transfer.predict(factors), exact.transfer.predict(factors), rtol=1e-6)
        moved, right = (
            np.square(factors) @ one.modulated / one.predict(factors) for one in (found.transfer, exact.transfer)
        )
        np.testing.assert_allclose(moved, right, atol=1e-6)
        size, right = (np.sqrt(np.diag(one.covariance(factors, noise, 30.0))) for one in (found, exact))
        np.testing.assert_allclose(size, right, rtol=1e-6 if value == 1.0 else 0.15)
        np.testing.assert_allclose(found.falling, found.falling.transpose(1, 0, 3, 2))
    grid = CauseGrid.of(curves)
    for place in (0, 7, 20):
        along = curves.along("x16", place / 20.0).transfer
        np.testing.assert_allclose(grid.gain[0, place], along.gain)
        np.testing.assert_allclose(grid.meshes[0, place], along.meshes)
    for code, value, message in (("x2", 1.0, "input 'x2', allowed: x16"), ("x16", 4.0, "x16 is 4, allowed: 0.333")):
        with pytest.raises(InputError, match=message):
            curves.at(code, value)


def test_curves_come_from_the_disk_unless_damaged(machine, monkeypatch):
    curves = cached_curves(machine, READING, workers=1)
    (file,) = cache_folder().iterdir()
    whole, computed = file.read_bytes(), []
    monkeypatch.setattr(curve_cache, "cause_curves", lambda *_: computed.append(1) or curves)
    again = cached_curves(machine, READING)
    np.testing.assert_array_equal(again.tables["x16"].gain, curves.tables["x16"].gain)
    np.testing.assert_array_equal(again.at("x16", 0.4).falling, curves.at("x16", 0.4).falling)
    assert not computed
    middle = len(whole) // 2
    for broken in (b"", whole[:middle], whole[:middle] + bytes(64) + whole[middle + 64 :], b"PK\x03\x04 and no zip"):
        file.write_bytes(broken)
        cached_curves(machine, READING)
        assert file.read_bytes() != broken
    assert len(computed) == 4
    # Another machine, operating point or reading has curves of its own.
    cached_curves(machine.with_inputs(x1=5.0), READING)
    cached_curves(machine, BandReading({"girder": Sensor()}, ((0.5, 20.0),)))
    assert len(list(cache_folder().iterdir())) == 3


def test_curves_are_computed_where_nothing_can_be_written(machine, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(curve_cache, "cause_curves", lambda *_: "computed")
    monkeypatch.setattr(curve_cache, "_written", lambda _: b"")
    assert cached_curves(machine, READING) == "computed"
