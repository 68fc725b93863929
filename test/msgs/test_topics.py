"""Topic names, quality of service, and what importing the package brings along."""

import subprocess
import sys
from types import SimpleNamespace

import pytest

from tbm_msgs_py import topics
from tbm_msgs_py.base.operating_point import OperatingPoint, OperatingPointError, from_joint_state


def test_names_of_the_contract():
    names = {
        topics.absolute(name)
        for name in (
            topics.OPERATING_POINT,
            topics.LOADS_BLOCK,
            topics.model_block("girder"),
            topics.field_accel("shield"),
            topics.analysis("gripper", "relative_error"),
            topics.DIAGNOSTICS,
        )
    }
    assert names == {
        "/tbm/operating_point",
        "/tbm/loads/block",
        "/tbm/model/girder/block",
        "/tbm/field/shield/accel",
        "/tbm/analysis/gripper/relative_error",
        "/diagnostics",
    }
    assert topics.absolute("loads/block", "/other") == "/other/loads/block"
    assert topics.absolute("x", "/") == "/x"


def test_unknown_quantity_is_refused():
    with pytest.raises(ValueError, match="model_rms, field_rms, relative_error"):
        topics.analysis("girder", "rms")


@pytest.mark.parametrize(
    ("name", "reliable", "latched"),
    [
        ("/tbm/operating_point", True, True),
        ("loads/operating_point", True, True),
        ("/tbm/model/girder/block", True, False),
        ("/tbm/model/girder/accel", False, False),
        ("model/drives", False, False),
        ("model/mesh_forces", True, False),
        ("/tbm/analysis/gsa_result", True, True),
        ("analysis/rock", True, True),
        ("/tbm/analysis/machine", True, True),
        ("analysis/girder/model_rms", True, False),
    ],
)
def test_quality_of_the_contract(name, reliable, latched):
    quality = topics.contract(name).quality
    assert (quality.reliable, quality.latched) == (reliable, latched)


def test_import_needs_no_ros():
    code = "import sys, tbm_msgs_py; sys.exit(any(m.split('.')[0] in ('rclpy', 'sensor_msgs') for m in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=300).returncode == 0


def joint_state(**changes):
    names, position, velocity, effort = OperatingPoint(0.586, 3.04e6, 1.2e7, 1.5, 6e-4).joints()
    return SimpleNamespace(**{"name": names, "position": position, "velocity": velocity, "effort": effort} | changes)


def test_operating_point_round_trip():
    assert from_joint_state(joint_state()) == OperatingPoint(0.586, 3.04e6, 1.2e7, 1.5, 6e-4)
    assert from_joint_state(joint_state(position=[])).head_angle == 0.0


@pytest.mark.parametrize(
    "changes", [{"name": ["cutterhead", "other"]}, {"effort": [1.0]}, {"velocity": []}, {"effort": [float("nan"), 1.0]}]
)
def test_bad_operating_point_is_one_line(changes):
    with pytest.raises(OperatingPointError) as caught:
        from_joint_state(joint_state(**changes))
    assert "\n" not in str(caught.value)
