"""What the command line takes of what everybody may publish: nothing of other machines, and no nonsense."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray
from peer import wait_for
from sensor_msgs.msg import PointCloud2

from tbm_gsa.app.nodes.watch import BlockCount, Watch
from tbm_msgs_py import ACCELERATION, topics
from tbm_msgs_py.nodes import messages, qos

OF_STUDY = {"state": "running", "done": 3, "total": 9}
OF_RESULT = {"surrogate": "krg", "r2_test": 0.9, "r2_cv": 0.8, "first_x1": 0.5}


def array(name, text="", values=None):
    return messages.diagnostics(0, [messages.status(name, "warn", text, values)])


@pytest.fixture
def watch():
    return Watch(["girder"])


def test_statuses_of_other_machines_do_not_enter(watch):
    for name in ("tbm: loads", "north: loads", "tbm_2: loads", "loads", ""):
        watch._on_diagnostics(array(name, "streaming", {"blocks": 3}))
    assert watch.state.diagnostics == {"tbm: loads": (1, "streaming", {"blocks": "3"})}


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("north: sensitivity analysis", OF_STUDY),
        ("tbm: sensitivity analysis", {}),
        ("tbm: sensitivity analysis", {**OF_STUDY, "done": "many"}),
        ("tbm: sensitivity analysis", {**OF_STUDY, "total": -1}),
    ],
)
def test_no_study_is_taken_from_elsewhere(watch, name, values):
    watch._on_gsa_status(array("tbm: sensitivity analysis", "by us", OF_STUDY))
    watch._on_gsa_status(array(name, "by them", values))
    assert watch.state.gsa == {"state": "running", "done": "3", "total": "9"}
    assert watch.state.gsa_message == "by us"


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("north: sensitivity of RDef_A", OF_RESULT),
        ("tbm: sensitivity of RDef_A", {}),
        ("tbm: sensitivity of RDef_A", {**OF_RESULT, "r2_cv": "good"}),
        ("tbm: sensitivity of RDef_A", {**OF_RESULT, "first_x2": ""}),
    ],
)
def test_no_result_is_taken_from_elsewhere(watch, name, values):
    watch._on_gsa_result(array("tbm: sensitivity of MF_M", "x1", OF_RESULT))
    watch._on_gsa_result(array(name, "x1", values))
    assert watch.state.result == {"MF_M": {key: str(value) for key, value in OF_RESULT.items()}}


@pytest.mark.parametrize(
    ("offsets", "counted"),
    [([0.0], 0), ([0.0, 0.0], 0), ([0.0, 1e-12], 0), ([1.0, 0.0], 0), ([np.nan, 1.0], 0), ([0.0, 80000.0], 4)],
)
def test_blocks_without_a_length_are_not_counted(offsets, counted):
    count = BlockCount()
    for stamp in (-(2**31) * 10**9, 0, 5, 3, (2**31 - 1) * 10**9):
        # The first is no ROS time.
        Watch._on_block(count, messages.block(ACCELERATION, stamp, offsets, np.zeros((len(offsets), 3))))
    assert count.received == counted


class _Flooded(Watch):
    """A watch to which every block that it handles brings another."""

    def _on_block(self, count, message):
        self.flood.publish(message)


def test_a_flooded_topic_starves_no_other():
    with _Flooded([]) as watch:
        watch.flood = watch._node.create_publisher(PointCloud2, topics.LOADS_BLOCK, qos.BLOCK)
        diagnostics = watch._node.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, qos.DIAGNOSTICS)
        wait_for(lambda: all(one.get_subscription_count() for one in (watch.flood, diagnostics)))
        for _ in range(20):
            watch.flood.publish(PointCloud2())
        diagnostics.publish(array("tbm: loads"))
        wait_for(lambda: watch.state.diagnostics, step=lambda: watch.spin(0.1))
