"""The calibration's tools: levels in the frequency domain against a run, values written into a machine file.

The prediction knows no mesh but the mean one, and the run is one realisation of 20 s: 10 Hz of noise scatters by 4 %
and a resonance 1 Hz wide by some 15 %, so 25 % tells a wrong transfer function from chance.
"""

import numpy as np
import pytest
from machine_files import TEXT

from tbm_dynamics import Machine, load_machine, simulate
from tbm_dynamics.calibration.free_values import FREE_VALUES, values_of
from tbm_dynamics.calibration.objective import objective
from tbm_dynamics.calibration.prediction import Prediction, predict
from tbm_dynamics.calibration.targets import PREDICTED_G
from tbm_dynamics.loads.description import COMPONENTS
from tbm_dynamics.machine.description import MachineDescription
from tbm_dynamics.machine.writing import edited_text
from tbm_msgs_py.base.units import STANDARD_GRAVITY


@pytest.fixture(scope="module")
def prediction(machine):
    return predict(machine)


def test_predicted_levels_against_a_run(machine, prediction):
    points = machine.description.test_points
    response = simulate(machine, 20.0, seed=5, outputs=points.values())
    for point, node in points.items():
        found = response.acceleration(node)[2000:, :3].std(axis=0)
        assert prediction.rms[point][0] == pytest.approx(found[0], rel=0.25)


def test_the_shipped_machine_is_the_calibrated_one(machine, prediction):
    # What docs/calibration.md says was reached.
    for point, level in PREDICTED_G.items():
        assert prediction.rms[point][0] / STANDARD_GRAVITY == pytest.approx(level, rel=0.15)
    assert np.any((prediction.axial_frequencies > 125.0) & (prediction.axial_frequencies < 135.0))
    fx = machine.description.loads.fx
    assert fx.fluctuation_rms < 0.2 * abs(fx.mean)
    mx = machine.description.loads.mx
    assert mx.fluctuation_rms < 0.3 * abs(mx.mean)
    assert prediction.mesh_lines[0.9] > 4.5e3
    assert prediction.mesh_lines[130.3] > 2.5e3


POINTS = ("cutterhead", "girder", "gripper", "shield")


def levels(**axial):
    return {
        point: np.full(3, axial.get(point, 0.1) * STANDARD_GRAVITY)
        for point in ("cutterhead", "girder", "gripper", "shield")
    }


def test_objective_is_zero_at_the_paper_and_counts_each_miss():
    right = levels(cutterhead=1.10, shield=0.56, gripper=0.04, girder=0.3)
    lines = {0.9: 6e3, 130.3: 5e3}
    assert objective(Prediction(right, np.array([10.0, 130.0]), lines), 0.1, 0.1) == 0.0
    assert objective(Prediction(right, np.array([10.0, 141.0]), lines), 0.1, 0.1) > 0.1
    assert objective(Prediction(right, np.array([130.0]), lines), 0.21, 0.1) > 0.1
    assert objective(Prediction(right, np.array([130.0]), lines), 0.1, 0.31) > 0.1
    faint = Prediction(right, np.array([130.0]), {0.9: 2.5e3, 130.3: 5e3})
    assert objective(faint, 0.1, 0.1) == pytest.approx(0.2 * np.log(2.0) ** 2)
    doubled = levels(cutterhead=2.20, shield=0.56, gripper=0.04, girder=0.3)
    assert objective(Prediction(doubled, np.array([130.0]), lines), 0.1, 0.1) == pytest.approx(np.log(2.0) ** 2)
    risen = levels(cutterhead=1.10, shield=0.56, gripper=0.04, girder=2.0)
    assert objective(Prediction(risen, np.array([130.0]), lines), 0.1, 0.1) > 0.5


def test_predicted_mesh_force_lines_against_a_run(machine, prediction):
    # Lines alone, teeth without error or variation: the amplitude at the line's own frequency over whole periods.
    quiet = machine.base.model_dump()
    quiet["driveshaft"]["mesh"].update(variation=0.0, error_factor=0.0)
    for name in COMPONENTS:
        quiet["loads"][name]["regions"] = ()
    response = simulate(Machine(MachineDescription.model_validate(quiet)), 21.0, outputs=(8,))
    force = response.mesh_force[10_000:, 0]
    for frequency, height in prediction.mesh_lines.items():
        turning = np.exp(-2j * np.pi * frequency * np.arange(len(force)) * 1e-4)
        # Random phases: the components' shares add up as powers in the mean, at worst linearly. Torque has the most.
        assert abs(2.0 * np.mean((force - force.mean()) * turning)) == pytest.approx(height, rel=0.25)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_values_are_written_where_they_belong_and_marked(tmp_path, share):
    searched = [low + share * (high - low) for low, high in (free.bounds for free in FREE_VALUES)]
    path = tmp_path / "trial.yaml"
    path.write_text(edited_text(TEXT, values_of(searched), "calibrated"), encoding="utf-8")
    description = load_machine(path).description
    head, *_ = description.cutterhead_bearing_gear.shafts
    girder = description.carrier_girder.shafts[1]
    assert head.mass == pytest.approx(120e3 + share * 100e3, rel=1e-3)
    assert (head.outer_diameter - head.inner_diameter) / 2 == pytest.approx(0.004 * 75.0**share, rel=0.01)
    assert girder.mass == pytest.approx(50e3 + share * 70e3, rel=1e-3)
    assert description.loads.fx.regions[0].rms == pytest.approx(1e5 * 22.0**share, rel=1e-3)
    assert {head.source, girder.source, description.loads.fx.lines[1].source} == {"calibrated"}
    # Nothing else has moved.
    shipped = load_machine("dz101").description
    assert description.all_connections() == shipped.all_connections()
    assert description.driveshaft == shipped.driveshaft
    assert description.loads.fy == shipped.loads.fy
