"""The linear system in the frequency domain, and the densities of the loads.

Sources: numpy's solution of the full matrices at single frequencies; scipy's Welch estimate of the loads themselves.
"""

import numpy as np
import pytest
import scipy.signal
from machine_files import built, plain, small

from tbm_dynamics import load_machine
from tbm_dynamics.frequency_response import FrequencyResponse
from tbm_dynamics.loads.density import SPACING_HZ, load_density
from tbm_dynamics.loads.description import COMPONENTS, LOAD_GROUPS

FREQUENCIES = np.array([0.9, 1.4, 6.3, 13.0, 33.0, 105.0, 130.3, 204.5])


def unlike():
    """Four drives: soft teeth, a motor that is off, one uncoupled."""
    data = small()
    data["driveshaft"]["count"] = 4
    data["drives"] = {2: {"tooth_stiffness": 0.3}, 3: {"off": True}, 4: {"off": "uncoupled", "misalignment": 0.5}}
    data["test_points"] = {"cutterhead": 1, "ring": 8, "pinion": 17, "rotor": 58}
    return built(data)


@pytest.mark.parametrize("machine", [load_machine("dz101"), built(small()), unlike()], ids=["dz101", "small", "unlike"])
def test_the_reduced_system_answers_as_the_full_one(machine):
    system = machine.assemble()
    dofs = [
        system.dof(node, axis) for node in machine.description.test_points.values() for axis in ("ux", "uy", "uz", "rx")
    ]
    found = FrequencyResponse(system, np.eye(system.size)[dofs]).accelerance(FREQUENCIES)
    omega = 2.0 * np.pi * FREQUENCIES[:, None, None]
    dynamic = system.K + 1j * omega * system.C - omega**2 * system.M
    loads = np.eye(system.size)[:, system.load_dofs]
    exact = -(omega**2) * np.linalg.solve(dynamic, np.broadcast_to(loads, (len(omega), *loads.shape)))[:, dofs]
    largest = np.abs(exact).max(axis=(0, 1))  # under each load
    assert np.all(np.abs(found - exact).max(axis=(0, 1)) < 3e-3 * largest)


def test_densities_have_the_power_that_the_file_says():
    description = load_machine("dz101").description.loads
    density, raw = load_density(description), plain()["loads"]
    assert np.all(density.noise >= 0.0)
    power = SPACING_HZ * density.noise.sum(axis=1)
    for column, name in enumerate(COMPONENTS):
        regions = [region["rms"] ** 2 for region in raw[name]["regions"]]
        lines = [line["amplitude"] ** 2 / 2.0 for line in raw[name]["lines"]]
        assert power[:, column].sum() == pytest.approx(sum(regions), rel=1e-6)
        assert density.line_power[:, :, column].sum() == pytest.approx(sum(lines))
    low, high = power[[LOAD_GROUPS.index(group) for group in ("axial_low", "axial_high")], 0]
    assert (low, high) == pytest.approx([region["rms"] ** 2 for region in raw["fx"]["regions"]], rel=1e-6)
    # What the factors are changes nothing of the densities at a factor of 1.
    assert np.array_equal(load_density(description.with_factors(np.full(6, 3.0))).noise, density.noise)


def test_densities_are_those_of_the_loads_themselves():
    machine, rate = load_machine("dz101"), 512.0
    loads = machine.loads(seed=2).evaluate(np.arange(round(120.0 * rate)) / rate)
    frequency, estimate = scipy.signal.welch(loads, rate, nperseg=1024, axis=0)
    density = load_density(machine.description.loads)
    for low, high in ((1.0, 9.0), (126.0, 129.0), (132.0, 134.0)):
        inside = (frequency >= low + 0.5) & (frequency <= high - 0.5)
        ours = (density.frequency >= low) & (density.frequency <= high)
        # 120 s × 2 Hz or more: a mean density scatters by less than 7 %.
        assert estimate[inside, 0].mean() == pytest.approx(density.noise[:, ours, 0].sum(axis=0).mean(), rel=0.25)
