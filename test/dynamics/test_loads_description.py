import numpy as np
import pytest
from pydantic import ValidationError

from tbm_dynamics.loads.description import LoadComponent, LoadDescription, LoadLine, LoadRegion


def region(low: float, high: float) -> dict[str, object]:
    return {"band": [low, high], "rms": 3.0, "source": "assumed"}


def component(**changes: object) -> dict[str, object]:
    return {"mean": -2.0, "scales_with": "thrust", "source": "table1", "regions": [region(0, 10)]} | changes


def test_fluctuation_rms_adds_the_powers_of_regions_and_lines():
    line = {"frequency": 0.9, "amplitude": 4.0 * np.sqrt(2.0), "source": "assumed"}
    assert LoadComponent.model_validate(component(lines=[line])).fluctuation_rms == pytest.approx(5.0)


def test_scale_follows_what_each_component_scales_with():
    names = ("fx", "fy", "fz", "mx", "my", "mz")
    with_torque = {"fy", "fz", "mx"}
    parts = {n: component(scales_with="torque" if n in with_torque else "thrust") for n in names}
    description = LoadDescription.model_validate(parts)
    assert description.scale(thrust_ratio=2.0, torque_ratio=3.0).tolist() == [2.0, 3.0, 3.0, 3.0, 2.0, 2.0]
    assert description.mean.tolist() == [-2.0] * 6


def test_a_region_from_zero_is_filled_from_half_a_hertz():
    assert LoadRegion.model_validate(region(0, 10)).filled == (0.5, 10.0)
    assert LoadRegion.model_validate(region(125, 135)).filled == (125.0, 135.0)


@pytest.mark.parametrize("band", [(-1, 10), (10, 5), (10, 11), (0, 2), (200, 300), (0, float("nan"))])
def test_impossible_bands_are_refused(band):
    with pytest.raises(ValidationError):
        LoadRegion.model_validate(region(*band))


def test_overlapping_regions_are_refused_with_both_named():
    with pytest.raises(ValidationError, match=r"\[0\.0, 10\.0\] and \[5\.0, 15\.0\] overlap"):
        LoadComponent.model_validate(component(regions=[region(5, 15), region(0, 10)]))


@pytest.mark.parametrize("frequency", [0.0, 0.5, 300.0, float("inf")])
def test_lines_outside_the_carried_range_are_refused(frequency):
    with pytest.raises(ValidationError):
        LoadLine.model_validate({"frequency": frequency, "amplitude": 1.0, "source": "assumed"})


def test_unknown_keys_are_refused():
    with pytest.raises(ValidationError, match="spread"):
        LoadComponent.model_validate(component(spread=1.0))
