"""`dynamics_node`: integrates the machine under the received loads and publishes what its sensors would feel."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState, PointCloud2
from threadpoolctl import threadpool_limits

from tbm_dynamics.integration.simulator import Chunk
from tbm_dynamics.machine.machine import Machine, load_machine
from tbm_dynamics.nodes.pacer import RealTimePacer
from tbm_dynamics.nodes.settings import DynamicsSettings
from tbm_dynamics.response import mean_pinion_speed, pinion_torque
from tbm_dynamics.streaming.sensors import LiveFilter, SensorModel, SensorPacket, SensorParameters
from tbm_dynamics.streaming.streams import DynamicsStream, step_ns
from tbm_msgs_py import blocks, topics
from tbm_msgs_py.base.drive_state import DriveState
from tbm_msgs_py.base.errors import InputError, SimulationError
from tbm_msgs_py.base.operating_point import OperatingPoint
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.blocks import BlockError
from tbm_msgs_py.nodes import messages
from tbm_msgs_py.nodes.fault_log import FaultLog
from tbm_msgs_py.nodes.managed import ManagedNode
from tbm_msgs_py.nodes.rate import Rate

LOADS_FRAME = "cutterhead"
_UNITS = {1e-3: "kN", 1e-6: "MN"}


class DynamicsNode(ManagedNode[DynamicsSettings]):
    """Lifecycle node: load blocks in, accelerations and mesh forces out."""

    def __init__(self, **options: Any) -> None:
        super().__init__("dynamics_node", DynamicsSettings, **options)

    def configure(self) -> None:
        """Assemble the machine, compile the kernel, create publishers and subscriptions."""
        threadpool_limits(1)  # small matrices: more threads only compete with the other nodes for the cores
        self._machine: Machine = load_machine(self.settings.machine)
        self._rate: float = self.settings.load_rate
        self._step = step_ns(self._rate)
        self._points = self._machine.description.sensor_places
        self._stream = self._new_stream()
        self._refused = 0
        self._faults: FaultLog[str] = FaultLog(lambda text: self.get_logger().warning(text))
        self._pacer = RealTimePacer()
        self._lost_shown = self._dropped_shown = self._restarts_shown = 0
        self._new_sensors()
        self._stream.warm_up()
        self._create_topics()

    def _new_stream(self) -> DynamicsStream:
        """Stream of the machine, if its meshes allow steps as long as the loads come."""
        try:
            return DynamicsStream(self._machine, self._rate, self.settings.loads)
        except SimulationError as error:
            raise InputError(f"parameter load_rate {self._rate:g} Hz: {error}") from None

    def _create_topics(self) -> None:
        self._blocks = {p: self.contract_publisher(topics.model_block(p)) for p in self._points}
        self._accels = {p: self.contract_publisher(topics.model_accel(p)) for p in self._points}
        self._meshes = self.contract_publisher(topics.MODEL_MESH_FORCES)
        self._drives = self.contract_publisher(topics.MODEL_DRIVES)
        self.contract_subscription(topics.LOADS_OPERATING_POINT, self._on_operating_point)

    def activate(self) -> None:
        """Subscribe to the loads: of those before nothing has been waiting."""
        self._received = Rate()
        self.contract_subscription(topics.LOADS_BLOCK, self._on_loads)

    def settings_changed(self, names: frozenset[str]) -> None:
        """Use another live rate."""
        if "live_rate" in names:
            self._new_live_filters()

    def _new_sensors(self) -> None:
        """Sensors and live filters for a fresh run."""
        rate, samples = self.settings.block_rate, self.settings.block_samples
        sensor = self.settings.sensor
        effects = sensor.model_dump(exclude={"rate"})
        parameters = SensorParameters(rate_hz=sensor.rate or rate, packet_samples=samples, **effects)
        whole = round(self._rate)
        self._sensors = {point: SensorModel(parameters, whole, self.settings.seed, point) for point in self._points}
        self._mesh_gate = samples, whole // rate
        self._mesh_offsets = np.arange(samples) * (whole // rate * self._step / NANOSECONDS)
        self._new_live_filters()
        self._mesh_pending = np.empty((0, self._stream.meshes))
        self._restarts = self._stream.restarts

    def _new_live_filters(self) -> None:
        stride = max(1, round(self._rate / self.settings.live_rate))
        self._live = {name: LiveFilter(self._rate, stride) for name in (*self._points, "drives")}

    def _on_operating_point(self, message: JointState) -> None:
        try:
            stamp, point = messages.operating_point_from(message)
            self._stream.set_operating_point(OperatingPoint(point.speed, point.torque, point.thrust), stamp)
        except InputError as error:
            self._faults.report(topics.LOADS_OPERATING_POINT, f"{topics.LOADS_OPERATING_POINT}: {error}; not used")
        else:
            self._faults.clear(topics.LOADS_OPERATING_POINT)

    def _on_loads(self, message: PointCloud2) -> None:
        start = time.perf_counter()
        try:
            block = messages.block_from(message)
            self._check_block(block)
            chunks = self._stream.process(int(block.times_ns()[0]), block.values)
            if self._stream.restarts != self._restarts:
                self._new_sensors()
            for chunk in chunks:
                self._publish(chunk)
        except (InputError, SimulationError) as error:
            self._refused += 1
            self._faults.report(topics.LOADS_BLOCK, f"{topics.LOADS_BLOCK}: {error}; not used")
            return
        self._faults.clear(topics.LOADS_BLOCK)
        self._check_units(block.values)
        self._received.add(len(block.values))
        length = len(block.values) / self._rate
        now = self.get_clock().now().nanoseconds
        self._pacer.add(length, time.perf_counter() - start, (now - block.stamp_ns) / NANOSECONDS - length)

    def _check_block(self, block: blocks.Block) -> None:
        if block.layout != blocks.LOADS:
            raise BlockError(
                f"block channels {' '.join(block.layout.channels)}, allowed: {' '.join(blocks.LOADS.channels)}"
            )
        if block.frame_id not in ("", LOADS_FRAME):
            raise BlockError(f"block frame_id {block.frame_id}, allowed: {LOADS_FRAME}")
        found = np.diff(block.offsets)
        if len(found) and not np.allclose(found, 1.0 / self._rate, rtol=1e-3, atol=0.0):
            raise BlockError(
                f"samples {found[0]:.6g} s apart, allowed: {1.0 / self._rate:g} s of load_rate {self._rate:g} Hz"
            )

    def _check_units(self, loads: np.ndarray) -> None:
        """Report a thrust that is off by a factor of units; the loads are used as they are."""
        asked = self._stream.mean_loads[0]
        share = loads[:, 0].mean() / asked if asked else 1.0
        unit = next((unit for factor, unit in _UNITS.items() if factor / 3.0 < share < 3.0 * factor), None)
        if unit is None:
            self._faults.clear("units")
        else:
            text = f"{topics.LOADS_BLOCK}: fx is about {share:.2g} of the operating point's thrust: values in {unit}?"
            self._faults.report("units", text)

    def _publish(self, chunk: Chunk) -> None:
        """Blocks first: what is shown live can wait."""
        motion, nodes = chunk.acceleration, self._stream.nodes
        points = {p: place.translation(motion[:, nodes.index(place.node)]) for p, place in self._points.items()}
        for point, acceleration in points.items():
            for packet in self._sensors[point].process(chunk.first_step, acceleration):
                self._publish_packet(point, packet)
        self._publish_meshes(chunk)
        for point, acceleration in points.items():
            for step, values in self._live[point].process(chunk.first_step, acceleration):
                self._accels[point].publish(messages.accel(self._stamp(step), values.tolist(), point))
        self._publish_drives(chunk)

    def _publish_drives(self, chunk: Chunk) -> None:
        torque = pinion_torque(self._machine, chunk.mesh_force)
        speed = tuple(mean_pinion_speed(self._machine, self._stream.operating_point.speed).tolist())
        for step, values in self._live["drives"].process(chunk.first_step, torque):
            state = DriveState(tuple(values.tolist()), speed)
            self._drives.publish(messages.drives_message(self._stamp(step), state))

    def _publish_packet(self, point: str, packet: SensorPacket) -> None:
        stamp = self._stream.epoch_ns + packet.stamp_ns
        message = messages.block(blocks.ACCELERATION, stamp, packet.time, packet.values, point)
        self._blocks[point].publish(message)

    def _publish_meshes(self, chunk: Chunk) -> None:
        samples, stride = self._mesh_gate
        kept = chunk.mesh_force[-chunk.first_step % stride :: stride]
        first = chunk.first_step + (-chunk.first_step % stride) - len(self._mesh_pending) * stride
        self._mesh_pending = np.concatenate([self._mesh_pending, kept])
        layout = blocks.mesh_forces(self._stream.meshes)
        while len(self._mesh_pending) >= samples:
            values, self._mesh_pending = self._mesh_pending[:samples], self._mesh_pending[samples:]
            self._meshes.publish(messages.block(layout, self._stamp(first), self._mesh_offsets, values, "ring"))
            first += samples * stride

    def _stamp(self, step: int) -> int:
        return self._stream.epoch_ns + step * self._step

    def statuses(self) -> list[DiagnosticStatus]:
        """Real-time factor, losses and what is wrong with the loads."""
        stream, pacer = self._stream, self._pacer
        lost, self._lost_shown = stream.lost_steps - self._lost_shown, stream.lost_steps
        dropped, self._dropped_shown = stream.dropped - self._dropped_shown, stream.dropped
        restarts, self._restarts_shown = stream.restarts - self._restarts_shown, stream.restarts
        problems = list(self._faults.show().values())
        problems += [f"{lost} lost steps bridged"] if lost else []
        problems += [f"{dropped} blocks beside the stream dropped{self._rivals()}"] if dropped else []
        problems += ["the loads jumped: the run started afresh"] if restarts else []
        values = {
            "blocks": pacer.blocks,
            "measured_rate_hz": self._received.mean(),
            "lost_steps": stream.lost_steps,
            "restarts": stream.restarts,
            "refused_blocks": self._refused,
            "dropped_blocks": stream.dropped,
            "lost_sensor_packets": sum(sensor.lost_packets for sensor in self._sensors.values()),
            **pacer.figures(),
        }
        silent = pacer.silent()
        level, text = self._judge(silent, problems)
        return [self.status("dynamics", level, text, values, self._machine.name)]

    def _judge(self, silent: float, problems: list[str]) -> tuple[messages.Level, str]:
        if self.clock_stands and not problems:
            return "ok", "the clock stands"
        if not self._pacer.blocks:
            return "warn", "; ".join([f"no block on {topics.LOADS_BLOCK} yet", *problems])
        if silent:
            return "error", "; ".join([f"no block on {topics.LOADS_BLOCK} for {silent:.0f} s", *problems])
        return ("warn", "; ".join(["integrating", *problems])) if problems else ("ok", "integrating")

    def _rivals(self) -> str:
        """Name two publishers of loads; asked only when there were any: one that was killed is listed for 20 s more."""
        names = sorted(p.node_name for p in self.get_publishers_info_by_topic(topics.LOADS_BLOCK))
        return f": {len(names)} publishers, {', '.join(names)}" if len(names) > 1 else ""
