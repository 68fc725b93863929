"""QoS of service as rosbag2 stores it, read and written."""

from __future__ import annotations

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.metadata import parse_qos

from tbm_msgs_py.topics import BLOCK_QOS, QoS

DEEPEST = 2**31 - 1  # messages of a queue, as DDS counts them
_FOREVER = QosTime(*divmod(2**63 - 1, 10**9))


def rosbag_profile(qos: QoS) -> Qos:
    """QoS of service as rosbag2 stores it."""
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=qos.depth,
        reliability=QosReliability.RELIABLE if qos.reliable else QosReliability.BEST_EFFORT,
        durability=QosDurability.TRANSIENT_LOCAL if qos.latched else QosDurability.VOLATILE,
        deadline=_FOREVER,
        lifespan=_FOREVER,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_FOREVER,
        avoid_ros_namespace_conventions=False,
    )


def offered_qos(text: str) -> QoS | None:
    """QoS of service that a recording states for a topic; None when it states none.

    Reliable and latched only when every recorded publisher was. A volatile queue is at least as deep as that of a
    block: depth is what keeps a fast stream whole.
    """
    try:
        profiles = parse_qos(text)
        possible = all(0 <= profile.depth <= DEEPEST for profile in profiles)
    except (ReaderError, KeyError, TypeError, ValueError, AttributeError):
        return None
    if not profiles or not possible:
        return None
    latched = all(profile.durability == QosDurability.TRANSIENT_LOCAL for profile in profiles)
    depth = max(profile.depth for profile in profiles)
    return QoS(
        reliable=all(profile.reliability != QosReliability.BEST_EFFORT for profile in profiles),
        latched=latched,
        depth=max(1, depth) if latched else max(depth, BLOCK_QOS.depth),
    )
