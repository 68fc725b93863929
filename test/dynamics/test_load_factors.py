"""Factors of the loads: amplitudes of a group of components in a region, by definition proportional to them.

Sources: the same realisation at other factors, and Table 1's regions and lines as the file lists them.
"""

import numpy as np
import pytest

from tbm_dynamics.loads.description import COMPONENTS, LOAD_GROUPS
from tbm_dynamics.loads.spectral import SpectralLoads

TIME = np.arange(0.0, 8.0, 1.0 / 512.0)
# By group: components, and the frequencies (Hz) between which it lies in dz101.
PLACES = {
    "axial_low": (("fx",), 0.0, 10.0),
    "axial_high": (("fx",), 125.0, 135.0),
    "torsion_low": (("mx",), 0.0, 10.0),
    "torsion_high": (("mx",), 125.0, 135.0),
    "lateral": (("fy", "fz"), 0.0, 210.0),
    "moments": (("my", "mz"), 0.0, 210.0),
}


def loads_at(machine, **factors):
    changed = machine.with_inputs(**{f"loads.{group}": value for group, value in factors.items()})
    return changed.loads(seed=4).evaluate(TIME)


def test_factors_of_one_leave_every_amplitude_as_it_is(machine):
    loads = machine.description.loads
    assert loads.components == tuple(getattr(loads, name) for name in COMPONENTS)
    assert loads.with_factors(np.ones(6)) == loads
    assert np.array_equal(machine.description.loads.factors.values, np.ones(6))


@pytest.mark.parametrize("group", LOAD_GROUPS)
def test_a_factor_scales_its_group_and_nothing_else(machine, group):
    none, one, two = (loads_at(machine, **{group: value}) for value in (0.0, 1.0, 2.0))
    own = one - none
    np.testing.assert_allclose(two - none, 2.0 * own, atol=1e-9 * np.abs(one).max())
    names, low, high = PLACES[group]
    others = [column for column, name in enumerate(COMPONENTS) if name not in names]
    assert np.array_equal(one[:, others], none[:, others])
    assert np.array_equal(one.mean(axis=0)[others], two.mean(axis=0)[others])
    power = np.square(np.abs(np.fft.rfft(own * np.hanning(len(own))[:, None], axis=0)))
    frequency = np.fft.rfftfreq(len(own), 1.0 / 512.0)
    inside = (frequency >= low) & (frequency <= high + 0.5)
    assert power[inside].sum() > 0.999 * power.sum() > 0.0


def test_all_factors_together_scale_the_whole_fluctuation(machine):
    loads = machine.description.loads
    still, one, three = (
        SpectralLoads(loads.with_factors(np.full(6, value)), seed=1).evaluate(TIME) for value in (0.0, 1.0, 3.0)
    )
    assert np.array_equal(still, np.broadcast_to(loads.mean, still.shape))
    np.testing.assert_allclose(three - still, 3.0 * (one - still), rtol=1e-9, atol=1e-6)
