"""`analysis_node`: known sines, the alarm, one sensitivity analysis at a time, each a process of its own."""

import os
import signal
import sqlite3

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from geometry_msgs.msg import AccelStamped, Vector3Stamped  # noqa: E402
from peer import alive, children, command_line, stamps  # noqa: E402
from processes import wait_for  # noqa: E402
from sensor_msgs.msg import Imu, JointState, PointCloud2  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from tbm_gsa.app.nodes.analysis_node import AnalysisNode  # noqa: E402
from tbm_gsa.history import Baseline, History  # noqa: E402
from tbm_gsa.history.baseline import ErrorStatistics  # noqa: E402
from tbm_msgs_py import ACCELERATION, OperatingPoint  # noqa: E402
from tbm_msgs_py.base.drive_state import DriveState  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402
from tbm_msgs_py.topics import ANALYSIS_QUANTITIES  # noqa: E402

pytestmark = pytest.mark.ros

NODE, GSA = "/tbm/analysis_node", "tbm: sensitivity analysis"
START_NS = 1_700_000_000_000_000_000
BLOCK_NS, SAMPLES, RATE = 50_000_000, 250, 5000.0
WINDOW_BLOCKS = 10  # of half a second
OFFSETS = np.arange(SAMPLES) / RATE
MODEL, FIELD = np.array([3.0, 1.0, 2.0]), np.array([2.0, 1.0, 4.0])  # amplitudes, m/s²
TINY = {"gsa.samples": 12, "gsa.test": 3, "gsa.duration": 0.1, "gsa.outputs": "[RDef_A, MF_M]", "gsa.quick": True}


def sine(amplitudes, block, offsets=OFFSETS):
    """50 Hz on a constant, as gravity is; (n, 3)."""
    phase = 2 * np.pi * 50.0 * (block * BLOCK_NS * 1e-9 + offsets)
    return np.sin(phase)[:, None] * amplitudes + [0.0, 0.0, 9.81]


def block_message(block, values):
    return messages.block(ACCELERATION, START_NS + block * BLOCK_NS, OFFSETS, values)


def listen_to(peer, point):
    return {q: peer.listen(Vector3Stamped, f"/tbm/analysis/{point}/{q}", qos.ANALYSIS) for q in ANALYSIS_QUANTITIES}


class Feed:
    """Streams of blocks, (publisher, block number → message) each, as fast as the node takes them."""

    def __init__(self, peer, node, windows, pairs):
        self._peer, self._node, self.windows, self.pairs = peer, node, windows, pairs
        self._block = 0

    def __call__(self, more=0, until=lambda: True):
        """Go on until so many more whole windows came of every signal, and longer until a condition holds."""
        self._peer.wait_for(lambda: all(publisher.get_subscription_count() for publisher, _ in self.pairs))
        wanted = {name: len(whole(values)) + more for name, values in self.windows.items()}
        self._peer.wait_for(
            lambda: all(len(whole(self.windows[name])) >= count for name, count in wanted.items()) and until(),
            step=self._step,
        )

    def _step(self):
        """A window, and what the node says then."""
        for _ in range(WINDOW_BLOCKS):
            for publisher, make in self.pairs:
                publisher.publish(make(self._block))
            self._block += 1
            self._peer.settle()
        self._node.report()


def vectors(received):
    return np.array([[m.vector.x, m.vector.y, m.vector.z] for m in received])


def whole(received):
    """Vectors after the first that is a number: up to it a publisher may not have been found yet."""
    numbers = np.isfinite(vectors(received).reshape(-1, 3)).all(axis=1)
    return vectors(received).reshape(-1, 3)[numbers.argmax() + 1 if numbers.any() else len(numbers) :]


def study_processes():
    """Ids of the running study, a child of this process, and of its workers; none before it has begun."""
    found = [pid for pid in children(os.getpid()) if "gsa" in command_line(pid)]
    return [*found[:1], *(worker for pid in found[:1] for worker in children(pid))]


class Study:
    """What the node says about its sensitivity analysis."""

    def __init__(self, peer):
        self._peer = peer
        self.messages = peer.listen(DiagnosticArray, "/tbm/analysis/gsa_status", qos.GSA)

    @property
    def states(self):
        values = [{pair.key: pair.value for pair in message.status[0].values} for message in self.messages]
        return [value["state"] for value in values]

    @property
    def text(self):
        return self.messages[-1].status[0].message

    def wait_for(self, state):
        self._peer.wait_for(lambda: self.states and self.states[-1] == state)


def test_windows_alarm_and_study(host_node, peer, tmp_path):
    windows = listen_to(peer, "shield")
    study = Study(peer)
    node = host_node(
        AnalysisNode,
        window=0.5,
        alarm="threshold",
        threshold=0.3,
        threshold_windows=8,
        **TINY,
        **{"gsa.folder": tmp_path / "studies"},
    )
    model = peer.node.create_publisher(PointCloud2, "/tbm/model/shield/block", qos.BLOCK)
    field = peer.node.create_publisher(PointCloud2, "/tbm/field/shield/block", qos.BLOCK)
    pairs = [
        (model, lambda k: block_message(k, sine(MODEL, k))),
        (field, lambda k: block_message(k, sine(FIELD, k))),
    ]
    feed = Feed(peer, node, windows, pairs)
    feed(3)
    starts = stamps(windows["model_rms"])
    assert starts[0] >= START_NS
    assert starts[0] % 500_000_000 == 0
    assert stamps(windows["field_rms"]) == stamps(windows["relative_error"]) == starts
    assert set(np.diff(starts[-3:])) == {500_000_000}
    error = np.abs(FIELD - MODEL) / FIELD  # equation (4)
    for quantity, expected, bound in (
        ("model_rms", MODEL / np.sqrt(2), {"rel": 0.01}),
        ("field_rms", FIELD / np.sqrt(2), {"rel": 0.01}),
        ("relative_error", error, {"abs": 0.02}),
    ):
        found = whole(windows[quantity])
        assert found == pytest.approx(np.tile(expected, (len(found), 1)), **bound)

    feed(5)
    study.wait_for("running")  # 50 % on x, eight times
    assert "shield" in study.text
    refused = peer.call(Trigger, "/tbm/analysis/run_gsa")
    assert not refused.success
    assert "running already" in refused.message
    assert not peer.value(GSA, "r2_cv_RDef_A")
    study.wait_for("finished")
    assert study.states[0] in ("idle", "running")
    results = peer.listen(DiagnosticArray, "/tbm/analysis/gsa_result", qos.GSA)  # latched: comes to the late
    peer.wait_for(lambda: results)
    names = {status.name.removeprefix("tbm: sensitivity of ") for status in results[0].status}
    assert names == {"RDef_A", "MF_M"}
    assert len(list((tmp_path / "studies").glob("gsa_*/report.html"))) == 1
    node.wait_for(lambda: peer.value(GSA, "state") == "finished")
    quality = {pair.key: pair.value for pair in results[0].status[0].values}
    output = results[0].status[0].name.rpartition(" ")[2]
    for key in ("surrogate", "r2_cv", "r2_test", "determined"):
        assert peer.value(GSA, f"{key}_{output}") == quality[key]
    assert "measured level over its threshold" in peer.said["tbm: comparison shield"]
    assert peer.text("tbm: comparison girder") == "no window yet"

    for t, reason in ((float("inf"), "not finite"), (1.7e9, "allowed: below 86400 s")):
        model.publish(messages.block(ACCELERATION, 0, [t] * SAMPLES, np.zeros((SAMPLES, 3))))
        node.wait_for(lambda reason=reason: reason in peer.text("tbm: comparison shield"))
    slow = [peer.node.create_publisher(PointCloud2, f"/tbm/{s}/girder/block", qos.BLOCK) for s in ("model", "field")]
    peer.wait_for(lambda: all(publisher.get_subscription_count() for publisher in slow))
    for k in range(12):  # 1 Hz
        for publisher in slow:
            publisher.publish(messages.block(ACCELERATION, START_NS + 2 * k * 10**9, [0.0, 1.0], np.ones((2, 3))))
    node.wait_for(lambda: "leaves no band" in peer.text("tbm: comparison girder"))
    pairs[1] = field, lambda k: block_message(k, sine(MODEL, k))
    feed(2)  # the alarm falls, and rises again
    pairs[1] = field, lambda k: block_message(k, sine(FIELD, k))
    feed(10, until=lambda: "the last one began" in node.output)
    assert len(list((tmp_path / "studies").glob("gsa_*"))) == 1
    assert "not finite" not in peer.text("tbm: comparison shield")
    # Alarm, start, no second one, end, two wrong blocks, two slow signals, alarm, not so soon.
    assert len(node.output.strip().splitlines()) == 10, node.output


def test_one_study_at_a_time_cancelled_or_killed(host_node, peer, tmp_path):
    study = Study(peer)
    node = host_node(AnalysisNode, autostart=False, **{**TINY, "gsa.samples": 2000, "gsa.folder": tmp_path})
    assert peer.transition(NODE, "configure")
    assert not peer.call(Trigger, "/tbm/analysis/run_gsa").success, "not active"
    assert not peer.call(Trigger, "/tbm/analysis/cancel_gsa").success
    assert peer.transition(NODE, "activate")
    study.wait_for("idle")

    file = tmp_path / "study.yaml"
    file.write_text("inputs: {x2: }")
    (refused,) = peer.set_parameters(NODE, gsa__inputs=str(tmp_path / "other.yaml"))
    assert "parameter gsa.inputs: " in refused
    assert not peer.set_parameters(NODE, gsa__inputs=str(file))
    file.write_text("inputs: {x99: }")  # changed since: the service says so, and starts nothing
    answer = peer.call(Trigger, "/tbm/analysis/run_gsa")
    assert (answer.success, "unknown input 'x99'" in answer.message) == (False, True)
    assert not peer.set_parameters(NODE, gsa__inputs="")

    assert peer.call(Trigger, "/tbm/analysis/run_gsa").success
    study.wait_for("running")
    node.wait_for(lambda: int(peer.value(GSA, "done") or 0) > 0)
    cancelled = study_processes()
    assert len(cancelled) >= 3  # the study and its two workers
    assert peer.call(Trigger, "/tbm/analysis/cancel_gsa").success
    study.wait_for("cancelled")
    wait_for(lambda: not any(map(alive, cancelled)))

    assert peer.call(Trigger, "/tbm/analysis/run_gsa").success
    peer.wait_for(lambda: len(study_processes()) >= 3)
    killed = study_processes()
    assert os.getpriority(os.PRIO_PROCESS, killed[0]) == 10  # it gives way to the nodes
    os.kill(killed[0], signal.SIGKILL)
    study.wait_for("failed")
    assert "killed" in study.text
    assert "[ERROR]" in next(line for line in node.output.splitlines() if "analysis failed" in line)
    node.wait_for(lambda: peer.text(GSA) == study.text)
    assert peer.diagnostics[GSA].level == 2
    wait_for(lambda: not any(map(alive, killed)))
    assert peer.call(Trigger, "/tbm/analysis/cancel_gsa").success  # somebody has taken note
    study.wait_for("cancelled")
    assert "killed" in study.text
    node.wait_for(lambda: peer.diagnostics[GSA].level == 0)

    assert peer.call(Trigger, "/tbm/analysis/run_gsa").success
    study.wait_for("running")
    peer.wait_for(study_processes)
    left = study_processes()
    node.close()
    wait_for(lambda: not any(map(alive, left)))
    assert len(list(tmp_path.glob("gsa_*"))) == 3


def test_mapped_topics_with_their_units_axes_and_types(host_node, peer, tmp_path):
    """A block in g with turned axes, an Imu whose driver publishes as sensors do, and drives on their motors' side."""
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(
        "topics:\n"
        "  /rig/head: {point: cutterhead, units: g, gravity: included, frame: fixed, axes: ['-z', x, y]}\n"
        "  /rig/imu: {point: gripper, units: m/s2, gravity: included, frame: fixed}\n"
        "drives: {topic: /rig/drives, ratio: 20}\n"
    )
    windows = {**listen_to(peer, "cutterhead"), **{f"gripper {k}": v for k, v in listen_to(peer, "gripper").items()}}
    node = host_node(AnalysisNode, window=0.5, mapping=mapping, threshold=10.0)
    sensor = qos.LIVE  # best effort
    head = peer.node.create_publisher(PointCloud2, "/rig/head", sensor)
    imu = peer.node.create_publisher(Imu, "/rig/imu", sensor)
    models = [
        peer.node.create_publisher(PointCloud2, f"/tbm/model/{point}/block", qos.BLOCK)
        for point in ("cutterhead", "gripper")
    ]

    motors, pinions = (
        peer.node.create_publisher(JointState, name, sensor) for name in ("/rig/drives", "/tbm/model/drives")
    )
    torque = 1600.0 * (np.arange(10) != 3)  # 2 s of 20 Hz; the fourth is off

    def drives(torques, k):
        return messages.drives_message(START_NS + k * BLOCK_NS, DriveState(tuple(torques), (100.0,) * 10))

    def turned(k):
        x, y, z = sine(FIELD, k).T / 9.80665
        return block_message(k, np.column_stack([y, z, -x]))

    class Samples:
        """Ten samples of 200 Hz a block."""

        def get_subscription_count(self):
            return imu.get_subscription_count()

        def publish(self, k):
            for offset in np.arange(10) * 5e-3:
                x, y, z = sine(FIELD, k, np.array([offset]))[0].tolist()
                message = Imu(header=messages.header(START_NS + k * BLOCK_NS + round(offset * 1e9)))
                message.linear_acceleration = messages.vector((x, y, z))
                imu.publish(message)
                peer.settle()

    pairs = [(model, lambda k: block_message(k, sine(MODEL, k))) for model in models]
    pairs += [(motors, lambda k: drives(torque, k)), (pinions, lambda k: drives([32e3] * 10, k))]
    feed = Feed(peer, node, windows, [*pairs, (head, turned), (Samples(), lambda k: k)])
    feed(3, until=lambda: "drive_4 is off in the recording" in peer.text("tbm: drives"))
    said = {key: float(peer.value("tbm: drives", key)) for key in ("field_running", "drive_1_field_torque")}
    assert said == {"field_running": 9.0, "drive_1_field_torque": pytest.approx(32e3, rel=1e-4)}
    assert vectors(windows["field_rms"])[-1] == pytest.approx(FIELD / np.sqrt(2), rel=0.01)
    assert vectors(windows["relative_error"])[-1] == pytest.approx(np.abs(FIELD - MODEL) / FIELD, abs=0.02)
    assert vectors(windows["gripper field_rms"])[-1] == pytest.approx(FIELD / np.sqrt(2), rel=0.05)


def test_alarms_are_set_against_a_baseline_of_the_history(host_node, peer, tmp_path):
    """An error of 50 % is no alarm for a machine whose baseline says so, but growth from there is one."""
    file = tmp_path / "h.sqlite"
    usual = {
        ("shield", axis): ErrorStatistics(0.0, 0.01, 9, float(value), 0.01)
        for axis, value in zip("xyz", np.log(FIELD / MODEL), strict=True)
    }
    with History(file) as history:
        history.store_baseline(Baseline("sound", "dz101", "", 1, 0, 1, usual))
        history.store_baseline(
            Baseline("sound", "south", "", 2, 0, 1, {("shield", "x"): ErrorStatistics(0.0, 0.01, 9, 0.0, 0.01)})
        )
    windows = listen_to(peer, "shield")
    node = host_node(
        AnalysisNode,
        window=0.5,
        history=file,
        baseline="sound",
        alarm="threshold",
        threshold_windows=2,
        **{"alarm_axes": "['x', 'y', 'z']", "gsa.on_threshold": False},
    )
    model = peer.node.create_publisher(PointCloud2, "/tbm/model/shield/block", qos.BLOCK)
    field = peer.node.create_publisher(PointCloud2, "/tbm/field/shield/block", qos.BLOCK)
    levels = {"field": FIELD}
    pairs = [
        (model, lambda k: block_message(k, sine(MODEL, k))),
        (field, lambda k: block_message(k, sine(levels["field"], k))),
    ]
    feed = Feed(peer, node, windows, pairs)
    feed(5, until=lambda: int(peer.value("tbm: history", "written") or 0) >= 15)
    assert peer.text("tbm: comparison shield") == "compared"
    with History(file) as history:  # while the node writes
        found = [window for window in history.windows() if window.entry.axis == "x"]
    # What is published carries stamps of another day: nobody measures that now.
    assert {(window.source.kind, window.source.name) for window in found} == {("replay", NODE)}
    assert found[-1].entry.relative_error == pytest.approx(0.5, abs=0.02)
    assert found[-1].entry.start_ns % 500_000_000 == 0
    assert found[-1].entry.field_crest_factor == pytest.approx(np.sqrt(2.0), rel=0.05)  # of a sine
    assert found[-1].entry.field_kurtosis == pytest.approx(1.5, rel=0.05)

    levels["field"] = np.array([2.5, 1.0, 4.0])  # a quarter more on x, under the threshold of 30 %
    feed(5)
    assert not node.says("level changed")
    levels["field"] = np.array([2.0, 1.5, 4.0])  # half as much again on y
    feed(2, until=lambda: node.says("level changed against sound by more than 0.3 for 2 windows"))
    assert peer.text("tbm: comparison shield") != "compared"

    assert not node.says("not used")
    assert peer.set_parameters(NODE, alarm="sequential") == []
    assert node.says("baseline sound: of the alarm threshold, and the alarm is sequential: not used")
    assert peer.set_parameters(NODE, alarm="threshold") == []
    (refused,) = peer.set_parameters(NODE, baseline="other")
    assert "no baseline other, there: sound" in refused
    with sqlite3.connect(file) as connection:  # the worst that can happen to the baseline while the node runs
        connection.execute("DROP TABLE usual_errors")
        connection.execute("DROP TABLE baselines")
    assert peer.set_parameters(NODE, threshold=0.5, alarm_axes=["x"]) == []
    (refused,) = peer.set_parameters(NODE, baseline="sound")
    assert "no such table: baselines" in refused
    assert peer.set_parameters(NODE, baseline="") == []


def test_stamps_of_another_time_are_called_that(host_node, peer):
    """A recording that is played beside nodes on the computer's clock; then on theirs."""
    node = host_node(AnalysisNode, window=0.5, history="none", **{"gsa.on_threshold": False})
    model = peer.node.create_publisher(PointCloud2, "/tbm/model/shield/block", qos.BLOCK)
    field = peer.node.create_publisher(PointCloud2, "/tbm/field/shield/block", qos.BLOCK)
    away = {"blocks": 10 * 86400 * 20}

    def far(k):
        return block_message(k - away["blocks"], sine(MODEL, k))

    feed = Feed(peer, node, {}, [(model, lambda k: block_message(k, sine(MODEL, k))), (field, far)])
    status = "tbm: comparison shield"
    remedy = "not compared: a recording needs its own clock (run --sim-time), a sensor one that is set"
    feed(until=lambda: peer.text(status) == f"stamps of the field are 10 d behind the model's, {remedy}")
    assert peer.diagnostics[status].level == 2
    assert node.output == f"[WARNING] shield: {peer.text(status)}"
    away["blocks"] = -3 * 60 * 20
    feed(until=lambda: f"stamps of the field are 3 min ahead of the model's, {remedy}" in peer.text(status))
    away["blocks"] = 0
    feed(until=lambda: peer.text(status) == "compared")
    assert all("shield" in line for line in node.output.splitlines())


def test_frames_marks_and_stamps_that_are_none_are_said(host_node, peer, tmp_path):
    """Two sensors on one topic, a driver that measures nothing, stamps that are no time; points of another machine."""
    mapping = tmp_path / "mapping.yaml"
    points = {"/two": "girder", "/mark": "shield", "/stamp": "gripper", "/belt": "belt"}
    sensor = "units: m/s2, gravity: removed, frame: fixed"
    mapping.write_text("topics:\n" + "".join(f"  {topic}: {{point: {p}, {sensor}}}\n" for topic, p in points.items()))
    node = host_node(AnalysisNode, mapping=mapping, history="none")
    publishers = {topic: peer.node.create_publisher(Imu, topic, qos.LIVE) for topic in points}
    others = [
        peer.node.create_publisher(AccelStamped, f"/tbm/field/{name}", qos.LIVE)
        for name in ("tail/accel", "girder/accel")
    ]
    peer.wait_for(lambda: all(publisher.get_subscription_count() for publisher in publishers.values()))

    def publish():
        for topic, publisher in publishers.items():
            for frame in ("left", "right") if topic == "/two" else ("",):
                message = Imu(header=messages.header(START_NS, frame))
                message.linear_acceleration_covariance[0] = -1.0 if topic == "/mark" else 0.0
                message.header.stamp.nanosec = 10**9 if topic == "/stamp" else 0
                publisher.publish(message)
                peer.settle()
        node.report()

    said = {
        "comparison girder": "frame_id 'right' beside 'left', which alone is used",
        "comparison shield": "linear_acceleration_covariance[0] is -1, the driver's word for not measured",
        "comparison gripper": "and 1000000000 ns is no ROS time",
        "analysis_node": "test point 'belt' is none of the machine's",
    }
    beside = [
        "/tbm/field/tail/accel: tail is no test point of the machine, allowed: ",
        "girder/accel: not in the mapping",
    ]
    peer.wait_for(lambda: all(text in peer.text(f"tbm: {name}") for name, text in said.items()), step=publish)
    node.wait_for(lambda: all(text in peer.text("tbm: analysis_node") for text in beside))
    assert [node.output.count(text) for text in beside] == [1, 1]
    for other in others:
        peer.node.destroy_publisher(other)
    node.wait_for(lambda: not any(text in peer.text("tbm: analysis_node") for text in beside))


def test_a_standstill_is_no_alarm_and_blocks_go_before_samples(host_node, peer):
    """The PLC says that the machine stands; beside the blocks a driver sends single samples of the same sensor."""
    windows = listen_to(peer, "shield")
    rule = {"alarm": "threshold", "threshold": 0.6, "threshold_windows": 2, "gsa.on_threshold": False}
    node = host_node(AnalysisNode, window=0.5, **rule)
    model = peer.node.create_publisher(PointCloud2, "/tbm/model/shield/block", qos.BLOCK)
    field = peer.node.create_publisher(PointCloud2, "/tbm/field/shield/block", qos.BLOCK)
    slow = peer.node.create_publisher(AccelStamped, "/tbm/field/shield/accel", qos.LIVE)
    plc = peer.node.create_publisher(JointState, "/tbm/operating_point", qos.OPERATING_POINT)
    level = {"field": FIELD}
    latest = {}

    def measured(k):
        latest["stamp"] = START_NS + k * BLOCK_NS
        slow.publish(messages.accel(latest["stamp"], sine(100.0 * FIELD, k)[0].tolist(), "shield"))
        return block_message(k, sine(level["field"], k))

    def drive(speed):
        plc.publish(messages.operating_point_message(latest.get("stamp", START_NS), OperatingPoint(speed, 3e6, 1e7)))

    pairs = [(model, lambda k: block_message(k, sine(MODEL, k))), (field, measured)]
    drive(0.6)
    status = "tbm: comparison shield"
    feed = Feed(peer, node, windows, pairs)
    feed(5, until=lambda: peer.text(status) == "compared")
    assert vectors(windows["field_rms"])[-1] == pytest.approx(FIELD / np.sqrt(2), rel=0.01)

    def rates():
        return [float(peer.value(status, f"{source}_rate_hz")) for source in ("model", "field")]

    feed(1, until=lambda: min(rates()) > 0.0)

    drive(0.0)
    level["field"] = 1e-3 * FIELD  # nothing but noise
    feed.windows = {"model_rms": windows["model_rms"]}
    standing = "not compared: the machine stands still"
    feed(8, until=lambda: peer.text(status) == standing)
    assert peer.diagnostics[status].level == 0
    assert np.isnan(vectors(windows["relative_error"])[-3:]).all()
    assert not node.says("measured and computed differ")

    drive(0.6)
    dead = "field measures next to nothing along x, y, z: a dead channel?"
    feed(6, until=lambda: dead in peer.text(status))
    assert not node.says("measured and computed differ")
    level["field"] = 0.1 * FIELD
    over = "measured and computed differ by more than 0.6 for 2 windows"
    feed(8, until=lambda: node.says(over))
    plc.publish(messages.operating_point_message(latest["stamp"], OperatingPoint(0.6, 3e3, 1e7)))
    doubt = (
        "operating point: torque (kN·m) 3 is about 0.00099 of the machine's own 3040: values in kN where the message"
    )
    feed(until=lambda: doubt in peer.text("tbm: analysis_node"))
