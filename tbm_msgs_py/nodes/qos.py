"""rclpy profiles of the qualities of service in `tbm_msgs_py.topics`."""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.topic_endpoint_info import TopicEndpointInfo

from tbm_msgs_py import topics
from tbm_msgs_py.topics import QoS


def profile(quality: QoS) -> QoSProfile:
    """Profile of rclpy for a quality of service."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=quality.depth,
        reliability=ReliabilityPolicy.RELIABLE if quality.reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if quality.latched else DurabilityPolicy.VOLATILE,
    )


def overridable() -> QoSOverridingOptions:
    """Options that declare ``qos_overrides.<topic>.<publisher or subscription>.{depth, reliability, durability}``."""
    return QoSOverridingOptions([QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY])


def offered(publishers: Iterable[TopicEndpointInfo]) -> QoS:
    """QoS of service that every publisher of a topic offers: asking for it matches all of them.

    Parameters
    ----------
    publishers : iterable of TopicEndpointInfo
        As `Node.get_publishers_info_by_topic` returns them.
    """
    profiles = [publisher.qos_profile for publisher in publishers]
    depths = [known.depth for known in profiles if known.history == HistoryPolicy.KEEP_LAST]
    return QoS(
        reliable=all(known.reliability == ReliabilityPolicy.RELIABLE for known in profiles),
        latched=all(known.durability == DurabilityPolicy.TRANSIENT_LOCAL for known in profiles),
        # Fast DDS does not publish the depth of others: the one that keeps a live topic whole.
        depth=max([0, *depths]) or topics.LIVE_QOS.depth,
    )


OPERATING_POINT = profile(topics.OPERATING_POINT_QOS)
LOADS_OPERATING_POINT = profile(topics.LOADS_OPERATING_POINT_QOS)
BLOCK = profile(topics.BLOCK_QOS)
LIVE = profile(topics.LIVE_QOS)
ANALYSIS = profile(topics.ANALYSIS_QOS)
GSA = profile(topics.GSA_QOS)
DIAGNOSTICS = profile(topics.DIAGNOSTICS_QOS)
CLOCK = profile(topics.CLOCK_QOS)
