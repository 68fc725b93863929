"""The production basis over the ranges of the 25 inputs: every indicator within 1 % of the method on every unknown.

The reference knows no basis (it is itself held against scipy's Radau in test_whole_system). Seen: at most 0.4 % over
eight machines; the undamped modes up to 180 Hz that were used before missed by up to 4.5 %. The reference takes two
seconds to set up for each machine, so three of them are always tried and all under `verify`.
"""

import numpy as np
import pytest

from tbm_dynamics import Simulator, load_machine
from tbm_dynamics.indicators import indicators
from tbm_gsa.sensitivity.study.design import make_design
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS

MACHINES = 12
ALWAYS = 3


@pytest.fixture(scope="module")
def samples():
    design = make_design(PAPER_INPUTS, MACHINES, 1, seed=5)
    return [PAPER_INPUTS.sample(row) for row in design.train]


@pytest.mark.parametrize(
    "number", [*range(ALWAYS), *(pytest.param(k, marks=pytest.mark.verify) for k in range(ALWAYS, MACHINES))]
)
def test_every_indicator_holds_over_the_inputs(samples, number):
    machine = load_machine("dz101").with_inputs(**samples[number])
    system = machine.assemble()
    loads = machine.loads(3).evaluate(np.arange(3000) * 1e-4)
    found, expected = (
        indicators(chunk.displacement[:, 0], chunk.acceleration[:, 1], chunk.mesh_force, 1.0)
        for chunk in (Simulator(system, (8, 14), method=method).step(loads) for method in ("reduced", "full"))
    )
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=0.01), name
