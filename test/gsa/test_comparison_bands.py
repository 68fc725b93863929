"""Bands and lines of a comparison are those of its machine.

Sources: turns of planetary gears counted by hand (Willis; ring held: carrier : sun = z_s : z_s + z_r); sines, whose
RMS is known.
"""

import numpy as np
import pytest
from compared_signals import compared, uniform
from hypothesis import given, settings
from hypothesis import strategies as st

from tbm_dynamics import Machine, load_machine
from tbm_dynamics.loads.description import LoadDescription
from tbm_dynamics.machine.description import MachineDescription
from tbm_gsa.comparison import Settings
from tbm_gsa.comparison.bands import bands_of_levels, machine_bands, parse_bands
from tbm_gsa.comparison.expected import expected_lines
from tbm_gsa.comparison.gears import shaft_speeds
from tbm_msgs_py.base.errors import InputError


def edited(name="open380", **loads):
    data = load_machine(name).base.model_dump()
    data["loads"].update(loads)
    return data


def rig():
    """Return one drive of open380 that turns the ring at 120 r/min: teeth mesh at 250, 987 and 4992 Hz."""
    data = edited()
    data["driveshaft"]["count"] = 1
    data["operating_point"] |= {"speed_r_min": 120.0, "torque_kn_m": 10.0}
    data["operating_limits"] = None
    return Machine(MachineDescription.model_validate(data))


@pytest.mark.parametrize(
    ("machine", "loads", "meshes"),
    [
        (load_machine("dz101"), ((0.5, 20.0), (100.0, 110.0), (125.0, 135.0), (200.0, 210.0)), (76.26, 361.3)),
        (load_machine("open380"), ((0.5, 20.0), (60.0, 120.0)), (18.75, 374.4)),
        (rig(), ((0.5, 20.0), (60.0, 120.0)), (250.0, 986.8)),
    ],
    ids=["dz101", "open380", "rig"],
)
def test_bands_hold_the_loads_and_the_meshes(machine, loads, meshes):
    found = machine_bands([machine], 1100.0)
    assert machine.description.loads.bands == loads
    own = [band for band in found if band not in loads]
    assert len(own) == len(meshes)
    assert set(loads) <= set(found)
    for mesh, (low, high) in zip(meshes, own, strict=True):
        assert low < 0.95 * mesh < 1.05 * mesh < high
    assert machine_bands([machine], 100.0) == tuple(band for band in found if band[1] <= 100.0)


def test_gears_and_shafts_turn_as_willis_has_it():
    lines = {line.name: line.frequency_hz for line in expected_lines(load_machine("open380"))}
    ring = 9.0 / 60.0
    pinion = ring * 125 / 19
    first = pinion * (21 + 75) / 21
    motor = first * (19 + 83) / 19
    assert shaft_speeds(load_machine("open380")) == pytest.approx(
        {"cutterhead": ring, "pinion shaft": pinion, "stage 1 sun shaft": first, "motor shaft": motor}
    )
    # The sun meets its planets at its speed relative to the carrier; a planet rolls in the held ring.
    assert lines["stage 1 mesh frequency"] == pytest.approx(21 * (first - pinion))
    assert lines["2 × stage 2 mesh frequency"] == pytest.approx(2 * 19 * (motor - first))
    assert lines["stage 2 mesh frequency + sun"] == pytest.approx(19 * (motor - first) + (motor - first))
    assert lines["stage 2 mesh frequency − planet"] == pytest.approx(19 * (motor - first) - first * 83 / 32)
    assert lines["mesh frequency + pinion"] == pytest.approx(125 * ring + pinion)
    assert "mesh frequency + ring" not in lines  # 0.15 Hz from the mesh: no spectrum here tells them apart
    assert lines["load line 67 Hz"] == 67.0
    assert "cutterhead" not in lines  # below what is compared


def test_bands_follow_the_speed_of_the_levels():
    machine = load_machine("open380")
    known = machine_bands([machine], 1000.0)
    assert bands_of_levels(known, [machine.with_inputs(x1=9.2)], 1000.0) == known
    slow = machine.with_inputs(x1=6.0)  # its second stage meshes at 249.6 Hz
    assert [band for band in bands_of_levels(known, [slow], 1000.0) if band[0] < 249.6 < band[1]]
    both = bands_of_levels(known, [machine, slow], 1000.0)
    assert set(known) < set(both)


def test_a_line_of_the_loads_has_a_band_of_its_own():
    still = {"mean": 1.0, "scales_with": "thrust", "source": "test"}
    line = {"frequency": 50.0, "amplitude": 1.0, "source": "test"}
    loads = LoadDescription.model_validate(
        dict.fromkeys(("fx", "fy", "fz", "my", "mz"), still) | {"mx": still | {"lines": [line]}}
    )
    assert loads.bands == ((48.0, 52.0),)


@pytest.mark.parametrize(("rate", "frequency"), [(1000.0, 400.0), (250.0, 100.0), (1000.0, 1.0)])
def test_lines_at_the_ends_of_the_band_have_their_height(rate, frequency):
    sine = [
        uniform(np.sin(2 * np.pi * frequency * np.arange(8 * r) / r)[:, None] * np.ones(3), r)
        for r in (int(rate), 2500)
    ]
    axis = compared(*sine).axes["x"]
    for line in (axis.field_lines[0], axis.model_lines[0]):
        assert line.frequency_hz == pytest.approx(frequency, abs=0.26)
        assert line.rms == pytest.approx(np.sqrt(0.5), rel=0.02)


def test_a_rig_is_compared_up_to_what_both_carry():
    field, model = (
        uniform(np.sin(2 * np.pi * 3600.0 * np.arange(2 * rate) / rate)[:, None] * np.ones(3), rate)
        for rate in (12_800, 10_000)
    )
    chosen = Settings(high_hz=4000.0, bands=((3500.0, 3700.0), (4200.0, 4300.0)))
    point = compared(field, model, settings=chosen)
    axis = point.axes["x"]
    assert point.band.high_hz == 4000.0
    assert axis.field_band_rms == {"3500-3700_hz": pytest.approx(axis.field_rms, rel=1e-3), "4200-4300_hz": None}
    heights = [side[0].rms for side in (axis.field_lines, axis.model_lines)]
    assert heights == pytest.approx([np.sqrt(0.5)] * 2, rel=0.02)
    assert (axis.windows.field_band_rms["4200-4300_hz"], axis.intervals.field_band_rms["4200-4300_hz"]) == (
        (None,),
        None,
    )
    with pytest.raises(InputError, match=r"band up to 4100 Hz, allowed: up to 4000, 0\.4 of the sampling rate"):
        compared(field, model, settings=Settings(high_hz=4100.0))


@settings(max_examples=30)
@given(st.lists(st.tuples(st.integers(1, 400), st.integers(1, 500)), min_size=1, max_size=8, unique=True))
def test_stated_bands_are_read_back(pairs):
    text = ", ".join(f"{low}-{low + width}" for low, width in pairs)
    assert parse_bands(text, 1000.0) == tuple((float(low), float(low + width)) for low, width in pairs)


@pytest.mark.parametrize(
    "text", ["", "5", "20-0.5", "0.1-20", "10-10.5", "900-1001", "5-nan", "5-20,", "5-20,5-20", "1e0-9", "-5-9"]
)
def test_bands_that_are_none_are_one_line(text):
    with pytest.raises(InputError, match=r"^bands? .*, allowed: ") as caught:
        parse_bands(text, 1000.0)
    assert "\n" not in str(caught.value)
