"""`load_node`: publishes the cutterhead loads in blocks, on the node's clock."""

from __future__ import annotations

import math
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState, PointCloud2

from tbm_dynamics.levels import LOAD_LEVELS
from tbm_dynamics.machine import Machine, MachineError, OperatingPoint, load_machine
from tbm_dynamics.schedule import COLUMNS, Schedule, pairs, read_schedule
from tbm_dynamics.streams import NANOSECONDS, LoadBlock, LoadStream, step_ns
from tbm_msgs_py import blocks, operating_point, topics
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.managed import ManagedNode, Parameter, run_node
from tbm_msgs_py.operating_point import OperatingPointError

# A clock that leaps further than this (a bag that loops, a suspended computer) starts the stream afresh.
_LONGEST_BACKLOG_S = 5.0

PARAMETERS = (
    Parameter("machine", "dz101", "machine: name of a shipped one, or path of a machine file"),
    Parameter("loads", "spectral", "Table 1's spectra, or the forces on the disc cutters", choices=LOAD_LEVELS),
    Parameter("schedule", "", "CSV file with the operating point over stream time; empty: as the topic says"),
    Parameter(
        "schedule_columns",
        [""],
        f"its columns, where not {' '.join(f'{key}={name}' for key, name in COLUMNS.items())}",
    ),
    Parameter("schedule_where", [""], "only rows with these cells, as column=text"),
    Parameter("seed", 0, "seed of the load realisation", minimum=0, maximum=2**31 - 1),
    Parameter("block_rate", topics.LOAD_BLOCK_RATE, "rate of the loads (Hz)", minimum=1000.0, maximum=50000.0),
    Parameter("block_samples", topics.LOAD_BLOCK_SAMPLES, "samples of a block", minimum=10, maximum=100000),
    Parameter("live_rate", topics.LIVE_RATE, "rate of loads/wrench (Hz)", minimum=1.0, maximum=1000.0),
    Parameter(
        "wait_for_subscribers",
        0,
        "subscribers of loads/block to wait for before the first block",
        minimum=0,
        maximum=16,
    ),
)


class LoadNode(ManagedNode):
    """Lifecycle node that turns (seed, operating point, time) into load blocks."""

    def __init__(self) -> None:
        super().__init__("load_node", PARAMETERS)

    def configure(self) -> None:
        """Load the machine and create the publishers."""
        self._machine: Machine = load_machine(self.value("machine"))
        self._rate = float(self.value("block_rate"))
        self._samples = int(self.value("block_samples"))
        self._step = step_ns(self._rate)
        self._live_stride = max(1, round(self._rate / float(self.value("live_rate"))))
        self._stream: LoadStream | None = None
        self._epoch_ns = 0
        self._refused = 0
        self._schedule = self._read_schedule()
        self._wanted: OperatingPoint | None = None  # of the topic, since the node was configured
        self._blocks = self.create_publisher(PointCloud2, topics.LOADS_BLOCK, qos.BLOCK)
        self._live = self.create_publisher(WrenchStamped, topics.LOADS_WRENCH, qos.BLOCK)
        self._applied = self.create_publisher(JointState, topics.LOADS_OPERATING_POINT, qos.OPERATING_POINT)
        self._diagnostics = self.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, qos.DIAGNOSTICS)
        self._subscription = self.create_subscription(
            JointState, topics.OPERATING_POINT, self._on_operating_point, qos.OPERATING_POINT
        )
        # Compiles and designs the filters now, not when the first block is due.
        self._new_stream().next_block()

    def _read_schedule(self) -> Schedule | None:
        file = self.value("schedule")
        if not file:
            return None
        columns, where = (pairs(name, self.value(name)) for name in ("schedule_columns", "schedule_where"))
        return read_schedule(file, columns, where)

    def _new_stream(self) -> LoadStream:
        return LoadStream(
            self._machine,
            int(self.value("seed")),
            1.0 / self._rate,
            self._samples,
            self.value("loads"),
            self._schedule,
        )

    def activate(self) -> None:
        """Start the stream; its epoch is the node's time, rounded to the step."""
        self._stream = None
        self._timer = self.create_timer(self._samples / self._rate / 2.0, self._tick)
        self._status_timer = self.create_status_timer(self._diagnose)

    def deactivate(self) -> None:
        """Stop the stream."""
        self.destroy_timer(self._timer)
        self.destroy_timer(self._status_timer)

    def cleanup(self) -> None:
        """Release publishers and subscription."""
        for publisher in (self._blocks, self._live, self._applied, self._diagnostics):
            self.destroy_publisher(publisher)
        self.destroy_subscription(self._subscription)

    def _on_operating_point(self, message: Any) -> None:
        try:
            given = operating_point.from_joint_state(message)
            wanted = OperatingPoint(given.speed, given.torque, given.thrust)
            (self._stream or self._new_stream()).set_operating_point(wanted)
        except (OperatingPointError, MachineError) as error:
            self._refused += 1
            self.get_logger().warning(f"{topics.OPERATING_POINT}: {error}; the last one stays")
            return
        self._wanted = wanted

    def _tick(self) -> None:
        now = self.get_clock().now().nanoseconds
        if self._stream is None and not self._begin(now):
            return
        stream = self._stream
        assert stream is not None  # noqa: S101 - _begin made it
        due = (now - self._epoch_ns) // self._step - stream.next_step
        if due < -self._samples or due > _LONGEST_BACKLOG_S * self._rate:
            self.get_logger().warning("the clock jumped: the load stream starts afresh")
            self._stream = None
            return
        while due >= self._samples and self.context.ok():
            self._publish(stream.next_block())
            due -= self._samples

    def _begin(self, now: int) -> bool:
        """Start the stream once the clock runs and enough subscribers are there."""
        if now == 0 or self._blocks.get_subscription_count() < self.value("wait_for_subscribers"):
            return False
        self._epoch_ns = round(now / self._step) * self._step
        self._stream = self._new_stream()
        if self._wanted is not None:
            self._stream.set_operating_point(self._wanted)
        self._announced: OperatingPoint | None = None
        return True

    def _publish(self, block: LoadBlock) -> None:
        stamp = self._epoch_ns + block.first_step * self._step
        if block.operating_point != self._announced:
            self._announced = block.operating_point
            point = operating_point.OperatingPoint(
                block.operating_point.speed,
                block.operating_point.torque,
                block.operating_point.thrust,
                block.head_angle,
            )
            self._applied.publish(messages.operating_point_message(stamp, point))
        offsets = [i * self._step / NANOSECONDS for i in range(len(block.loads))]
        self._blocks.publish(messages.block(blocks.LOADS, stamp, offsets, block.loads, "cutterhead"))
        first = -block.first_step % self._live_stride
        for i in range(first, len(block.loads), self._live_stride):
            self._live.publish(messages.wrench(stamp + i * self._step, block.loads[i], "cutterhead"))

    def _diagnose(self) -> None:
        now = self.get_clock().now().nanoseconds
        running = self._stream is not None
        point = self._stream.operating_point if self._stream else self._wanted or self._machine.operating_point
        values = {
            "blocks": self._stream.next_step // self._samples if self._stream else 0,
            "rate_hz": self._rate,
            "refused_operating_points": self._refused,
            "speed_r_min": point.speed * 60.0 / (2.0 * math.pi),
            "torque_kn_m": point.torque / 1e3,
            "thrust_kn": point.thrust / 1e3,
        }
        text = "streaming" if running else "waiting for the clock or for subscribers"
        status = messages.status("tbm: loads", "ok" if running else "warn", text, values, self._machine.name)
        self._diagnostics.publish(messages.diagnostics(now, [status]))


def main() -> None:
    """Run the node."""
    sys.exit(run_node(LoadNode))


if __name__ == "__main__":
    main()
