"""What is wrong is said once a minute, whatever numbers are in the line."""

import pytest

pytest.importorskip("rclpy")

from tbm_msgs_py.nodes.faults import REPEAT_S, Faults

pytestmark = pytest.mark.ros


def test_a_line_comes_once_a_minute_whatever_its_numbers():
    clock, said = [0.0], []
    faults = Faults(said.append, lambda: clock[0])
    for k in range(400):
        faults.report("units", f"fx is about {1e-6 * (0.96 + 0.01 * (k % 9)):.2g} of the thrust: values in MN?")
        clock[0] += 0.05
    assert len(said) == 1
    clock[0] = REPEAT_S + 1.0
    faults.report("units", "fx is about 1e-06 of the thrust: values in MN?")
    assert len(said) == 2


def test_two_faults_in_turn_are_two_lines_a_minute():
    clock, said = [0.0], []
    faults = Faults(said.append, lambda: clock[0])
    for _ in range(1000):
        for text in ("block frame_id a, allowed: cutterhead", "loads hold a value that is not finite"):
            faults.report("loads", text)
        clock[0] += 0.1
        assert faults.show() == {"loads": text}
    assert len(said) == 4
    faults.clear("loads")
    assert faults.show() == {"loads": text}
    assert faults.show() == {}
