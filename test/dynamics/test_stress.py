"""Stresses of the shafts under the hardest point, against a bar by hand.

The small machine with the rock at the ring: its shaft is then a cantilever, loaded at its tip by nothing but the
cutterhead loads. Sources: σ = N/A + M r/I, τ = T r/J of a tube and von Mises' σ_v (any textbook); statics to 1e-6.
"""

import numpy as np
import pytest
from machine_files import all_connections, built, rock, small

from tbm_dynamics.machine.stress import hardest_point, overstressed, shaft_stresses

OUTER, INNER, LENGTH = 4.0, 3.4, 2.5


def cantilever(**means):
    data = small()
    rock(data)[1]["between"] = [8, "ground"]
    for name, mean in means.items():
        data["loads"][name]["mean"] = mean
    return data


def by_hand(data, thrust, torque):
    """Largest stress (Pa) at the shaft's two ends; thrust and torque over those of the file's operating point."""
    scale = {"fx": thrust, "my": thrust, "mz": thrust, "fy": torque, "fz": torque, "mx": torque}
    fx, fy, fz, mx, my, mz = (
        scale[name] * data["loads"][name]["mean"] for name in ("fx", "fy", "fz", "mx", "my", "mz")
    )
    area = np.pi / 4 * (OUTER**2 - INNER**2)
    second = np.pi / 64 * (OUTER**4 - INNER**4)
    # At the ring, behind the tip, the lateral forces have their lever.
    bending = max(np.hypot(my, mz), np.hypot(my - LENGTH * fz, mz + LENGTH * fy))
    sigma = abs(fx) / area + bending * OUTER / 2 / second
    tau = abs(mx) * OUTER / 2 / (2 * second)
    return np.sqrt(sigma**2 + 3 * tau**2)


@pytest.mark.parametrize(
    "means",
    [
        {},
        {"fy": 9e5, "fz": -7e5},
        {"fy": -9e5, "fz": 7e5, "my": -4e5},
        {"fy": 1e-3, "fz": 0.0, "my": 0.0, "mz": 0.0},
    ],
)
def test_a_bar_under_force_torque_and_bending(means):
    data = cantilever(**means)
    machine = built(data)
    (found,) = shaft_stresses(machine, machine.assemble())
    assert found.shaft.nodes == (1, 8)
    # The largest that is allowed: 23 000 kN and 8 410 kN·m, of 12 000 and 3 040.
    assert found.stress == pytest.approx(by_hand(data, 23000 / 12000, 8410 / 3040), rel=1e-6)


def test_without_limits_the_operating_point_is_the_hardest():
    data = cantilever()
    del data["operating_limits"]
    machine = built(data)
    assert hardest_point(machine) == machine.operating_point
    (found,) = shaft_stresses(machine, machine.assemble())
    assert found.stress == pytest.approx(by_hand(data, 1.0, 1.0), rel=1e-6)


def test_thrust_from_behind_loads_what_it_runs_through():
    # Rock at the tip again: a thrust on the head never enters the shaft but by its springs, that of cylinders does.
    data = small()
    for name in ("fy", "fz", "my", "mz"):
        data["loads"][name]["mean"] = 0.0
    plain = built(data)
    (cylinders,) = [one for one in all_connections(data) if one["between"] == [10, 12]]
    cylinders.update(type="hydraulic", force_controlled=True)
    held = built(data)
    (less,), (found,) = (shaft_stresses(machine, machine.assemble()) for machine in (plain, held))
    assert found.stress == pytest.approx(by_hand(data, 23000 / 12000, 8410 / 3040), rel=1e-6)
    assert less.stress < found.stress


@pytest.mark.parametrize(("share", "told"), [(1.001, False), (0.999, True)])
def test_what_exceeds_the_allowable_stress_is_told(share, told):
    data = cantilever()
    stress = by_hand(data, 23000 / 12000, 8410 / 3040)
    data["steel"]["allowable_stress"] = share * stress
    machine = built(data)
    line = overstressed(machine, machine.assemble())
    expected = f"cutterhead_bearing_gear.shafts: nodes 1 to 8: {stress / 1e6:.0f} MPa under 23000 kN and 8410 kN·m"
    assert line.startswith(expected) if told else line is None
