"""Dynamics and analysis work without ROS 2.

Source: Python's own list of loaded modules in a fresh process; rclpy is made unimportable there, so that a package that
needs it would fail.
"""

import subprocess
import sys

import pytest

PROGRAM = """
import sys
sys.modules["rclpy"] = None  # an import of it raises ImportError
{code}
loaded = [name for name in sys.modules if name.split(".")[0] in {{"rclpy", "std_msgs", "sensor_msgs", "rosgraph_msgs"}}]
print(",".join(name for name in loaded if sys.modules[name] is not None))
"""


@pytest.mark.parametrize(
    "code", ["import tbm_dynamics, tbm_gsa", "from tbm_dynamics.streaming import sensors, streams"]
)
def test_no_ros_is_loaded(code):
    program = PROGRAM.format(code=code)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == ""


def test_the_dynamics_never_load_the_analysis():
    program = (
        "import sys, tbm_dynamics.streaming.streams; print([n for n in sys.modules if n.split('.')[0] == 'tbm_gsa'])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "[]"
