"""Names, quality of service and default rates of every topic, without ROS.

Names are relative: a node in the default namespace ``/tbm`` publishes ``model/girder/block`` as
``/tbm/model/girder/block``.
"""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import NamedTuple

NAMESPACE = "/tbm"
LARGEST_DEPTH = 100_000  # of a queue: no stream needs more, and the middleware takes no number of any size
TEST_POINTS = ("cutterhead", "shield", "walkway", "girder", "gripper")

MODEL_BLOCK_RATE = 5000.0  # Hz
MODEL_BLOCK_SAMPLES = 250
LOAD_BLOCK_RATE = 10000.0  # Hz
LOAD_BLOCK_SAMPLES = 500
LIVE_RATE = 100.0  # Hz
WINDOW = 2.0  # s
ERROR_THRESHOLD = 0.30
ERROR_WINDOWS = 3

OPERATING_POINT = "operating_point"
LOADS_OPERATING_POINT = "loads/operating_point"
LOADS_BLOCK = "loads/block"
LOADS_WRENCH = "loads/wrench"
MODEL_DRIVES = "model/drives"
MODEL_MESH_FORCES = "model/mesh_forces"
FIELD_DRIVES = "field/drives"
GSA_STATUS = "analysis/gsa_status"
GSA_RESULT = "analysis/gsa_result"
ROCK = "analysis/rock"
MACHINE = "analysis/machine"
EVENTS = "analysis/events"
CONTEXT = "context"
RUN_GSA = "analysis/run_gsa"
CANCEL_GSA = "analysis/cancel_gsa"
DIAGNOSTICS = "/diagnostics"
CLOCK = "/clock"

ANALYSIS_STATUSES = (GSA_STATUS, GSA_RESULT, ROCK, MACHINE, EVENTS)
"""Topics of statuses, each with the newest one for those who come late."""
ANALYSIS_QUANTITIES = ("model_rms", "field_rms", "relative_error")


@dataclass(frozen=True)
class QoS:
    """Quality of service of a topic; history is always keep-last.

    Attributes
    ----------
    reliable : bool
        Reliable delivery, else best effort.
    latched : bool
        A late subscriber gets the last messages (transient local durability).
    depth : int
        Messages that a publisher keeps, and that may wait at a reader: of a latched topic only the newest is kept.
    """

    reliable: bool
    latched: bool
    depth: int


OPERATING_POINT_QOS = LOADS_OPERATING_POINT_QOS = CONTEXT_QOS = QoS(reliable=True, latched=True, depth=1)
BLOCK_QOS = QoS(reliable=True, latched=False, depth=64)
# Best effort like any sensor; the depth is what keeps a 1 kHz stream whole in a busy process.
LIVE_QOS = QoS(reliable=False, latched=False, depth=100)
ANALYSIS_QOS = QoS(reliable=True, latched=False, depth=64)
GSA_QOS = QoS(reliable=True, latched=True, depth=1)
DIAGNOSTICS_QOS = QoS(reliable=True, latched=False, depth=10)
# Reliable offers match both kinds of clock subscriber.
CLOCK_QOS = QoS(reliable=True, latched=False, depth=10)


class TopicContract(NamedTuple):
    """Message type of a topic, as ``package/msg/Type``, and its quality of service: of the contract, or on offer."""

    type: str
    quality: QoS


_JOINTS, _STATUSES = "sensor_msgs/msg/JointState", "diagnostic_msgs/msg/DiagnosticArray"
# By relative name; the first pattern that fits holds.
_CONTRACT = {
    OPERATING_POINT: TopicContract(_JOINTS, OPERATING_POINT_QOS),
    LOADS_OPERATING_POINT: TopicContract(_JOINTS, LOADS_OPERATING_POINT_QOS),
    CONTEXT: TopicContract(_STATUSES, CONTEXT_QOS),
    LOADS_WRENCH: TopicContract("geometry_msgs/msg/WrenchStamped", BLOCK_QOS),
    MODEL_DRIVES: TopicContract(_JOINTS, LIVE_QOS),
    FIELD_DRIVES: TopicContract(_JOINTS, LIVE_QOS),
    "*/accel": TopicContract("geometry_msgs/msg/AccelStamped", LIVE_QOS),
    **dict.fromkeys(ANALYSIS_STATUSES, TopicContract(_STATUSES, GSA_QOS)),
    "analysis/*": TopicContract("geometry_msgs/msg/Vector3Stamped", ANALYSIS_QOS),
    DIAGNOSTICS: TopicContract(_STATUSES, DIAGNOSTICS_QOS),
    CLOCK: TopicContract("rosgraph_msgs/msg/Clock", CLOCK_QOS),
    "*": TopicContract("sensor_msgs/msg/PointCloud2", BLOCK_QOS),
}


def model_block(point: str) -> str:
    """Topic of the modelled acceleration blocks of a test point."""
    return f"model/{point}/block"


def model_accel(point: str) -> str:
    """Topic of the modelled acceleration of a test point at the live rate."""
    return f"model/{point}/accel"


def field_block(point: str) -> str:
    """Topic of the measured acceleration blocks of a test point."""
    return f"field/{point}/block"


def field_accel(point: str) -> str:
    """Topic of the measured acceleration of a test point, one sample a message."""
    return f"field/{point}/accel"


def analysis(point: str, quantity: str) -> str:
    """Topic of one compared quantity of a test point.

    Parameters
    ----------
    point : str
        Test point.
    quantity : str
        One of `ANALYSIS_QUANTITIES`.
    """
    if quantity not in ANALYSIS_QUANTITIES:
        raise ValueError(f"quantity {quantity!r}, allowed: {', '.join(ANALYSIS_QUANTITIES)}")
    return f"analysis/{point}/{quantity}"


def absolute(name: str, namespace: str = NAMESPACE) -> str:
    """Full name of a relative topic in a namespace; a name that is already absolute stays as it is."""
    return name if name.startswith("/") else f"{namespace.rstrip('/')}/{name}"


def status_name(task: str, namespace: str = NAMESPACE) -> str:
    """Name on `/diagnostics` of a task of the machine in a namespace, so that two machines stay apart."""
    return f"{namespace.strip('/')}: {task}"


def contract(name: str, namespace: str = NAMESPACE) -> TopicContract:
    """Type and quality of service that the contract gives a topic, by its absolute or relative name."""
    name = name.removeprefix(f"{namespace.rstrip('/')}/")
    return next(found for pattern, found in _CONTRACT.items() if fnmatchcase(name, pattern))
