"""Order of convergence of both methods, and the split basis for any number of drives.

Sources: with loads that do not vary within a step what is left is the quadrature of the couplings' residual, of order 3
in the production method (implicit exponential Adams of two steps: Hochbruck and Ostermann, BIT 51, 2011) and of order
4 in the reference (Lobatto); loads that run linearly between the steps, where they are curved, make it 2. Measured from
three halvings of the step against an eighth of the smallest; orders to 0.15 (the reference is somewhat better than 4 in
the range where stages still count). For the number of drives the reference method knows nothing of any split.
"""

import numpy as np
import pytest
from machine_files import built, small, static_mesh_force
from test_simulation import swinging

from tbm_dynamics import Simulator
from tbm_dynamics.indicators import indicators

STEPS = (2e-4, 1e-4, 5e-5, 2.5e-5)  # the gearbox's teeth turn at 1.1 kHz
FINEST = 3.125e-6


def errors(method, amplitude=None):
    """Largest error of the mesh force at each step; mean loads, or swinging ones. The teeth turn at 43 Hz."""
    data = small()
    data["operating_point"]["speed_r_min"] *= 3.0
    del data["operating_limits"]
    system = built(data).assemble()

    def force(step):
        times = np.arange(round(0.04 / step)) * step
        loads = np.tile(system.mean_load, (len(times), 1)) if amplitude is None else swinging(system, amplitude)(times)
        return Simulator(system, (1,), step, method).step(loads).mesh_force

    exact = force(FINEST)
    assert exact.min() > 0.0  # a change of contact is no smooth residual
    return [np.abs(force(step) - exact[:: round(step / FINEST)]).max() for step in STEPS]


@pytest.mark.parametrize(("method", "order", "above"), [("reduced", 3.0, 0.15), ("full", 4.0, 0.5)])
def test_order_with_constant_loads(method, order, above):
    actual = np.array(errors(method))
    orders = np.log2(actual[:-1] / actual[1:])
    assert np.all((orders > order - 0.15) & (orders < order + above)), orders
    assert orders[-1] == pytest.approx(order, abs=0.15)


def test_order_with_loads_linear_between_the_steps():
    actual = np.array(errors("full", 0.3))
    assert np.log2(actual[-2] / actual[-1]) == pytest.approx(2.0, abs=0.15)


@pytest.mark.parametrize("drives", [1, 2, 3, 5, 9])
def test_any_number_of_drives(drives):
    # One and two leave fewer patterns than 1, cos and sin; nine do not fill whole registers.
    data = small()
    data["driveshaft"]["count"] = drives
    machine = built(data)
    system = machine.assemble()
    loads = swinging(system, 0.2)(np.arange(2000) * 1e-4)
    reduced, full = (Simulator(system, (8, 14), method=method).step(loads) for method in ("reduced", "full"))
    assert full.mesh_force.min() > 0.0
    share = static_mesh_force(machine)
    actual, expected = (
        list(indicators(chunk.displacement[:, 0], chunk.acceleration[:, 1], chunk.mesh_force, share).values())
        for chunk in (reduced, full)
    )
    assert actual == pytest.approx(expected, rel=0.01)
    assert np.abs(reduced.mesh_force - full.mesh_force).max() < 1e-3 * full.mesh_force.max()
