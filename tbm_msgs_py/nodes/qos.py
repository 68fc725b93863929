"""rclpy profiles of the qualities of service in `tbm_msgs_py.topics`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.topic_endpoint_info import TopicEndpointInfo

from tbm_msgs_py import topics
from tbm_msgs_py.topics import QoS

OVERRIDES = "qos_overrides."
"""Beginning of the parameters that override a quality of service."""
_POLICIES = {"reliability": ("reliable", "best_effort"), "durability": ("volatile", "transient_local")}


def profile(quality: QoS) -> QoSProfile:
    """Profile of rclpy for a quality of service."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=quality.depth,
        reliability=ReliabilityPolicy.RELIABLE if quality.reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if quality.latched else DurabilityPolicy.VOLATILE,
    )


def replayed(topic: str, recorded: QoS) -> QoSProfile:
    """Profile to play a topic with: as recorded, but of a latched one of the contract only the newest is kept."""
    contract = topics.contract(topic).quality
    return profile(replace(recorded, depth=contract.depth) if contract.latched else recorded)


def overridable() -> QoSOverridingOptions:
    """Options that declare ``qos_overrides.<topic>.<publisher or subscription>.{depth, reliability, durability}``."""
    return QoSOverridingOptions([QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY])


def override_problem(name: str, value: object) -> str:
    """Say what is wrong with the value of a parameter that overrides a quality of service; empty if nothing is."""
    if not name.startswith(OVERRIDES):
        return ""
    policy = name.rpartition(".")[2]
    if policy == "depth":
        right = isinstance(value, int) and 1 <= value <= topics.LARGEST_DEPTH
        return "" if right else f"{name}: {value}, allowed: 1 to {topics.LARGEST_DEPTH}"
    allowed = _POLICIES.get(policy, ())
    return f"{name}: {value}, allowed: {', '.join(allowed)}" if allowed and value not in allowed else ""


def offered(publishers: Iterable[TopicEndpointInfo]) -> QoS:
    """Quality of service that every publisher of a topic offers: asking for it matches all of them.

    Parameters
    ----------
    publishers : iterable of TopicEndpointInfo
        As `Node.get_publishers_info_by_topic` returns them.
    """
    profiles = [publisher.qos_profile for publisher in publishers]
    depths = [known.depth for known in profiles if known.history == HistoryPolicy.KEEP_LAST]
    latched = all(known.durability == DurabilityPolicy.TRANSIENT_LOCAL for known in profiles)
    return QoS(
        reliable=all(known.reliability == ReliabilityPolicy.RELIABLE for known in profiles),
        latched=latched,
        # Fast DDS does not publish the depth of others: the newest of a state, what keeps a live topic whole.
        depth=max([0, *depths]) or (1 if latched else topics.LIVE_QOS.depth),
    )


OPERATING_POINT = profile(topics.OPERATING_POINT_QOS)
LOADS_OPERATING_POINT = profile(topics.LOADS_OPERATING_POINT_QOS)
BLOCK = profile(topics.BLOCK_QOS)
LIVE = profile(topics.LIVE_QOS)
ANALYSIS = profile(topics.ANALYSIS_QOS)
GSA = profile(topics.GSA_QOS)
DIAGNOSTICS = profile(topics.DIAGNOSTICS_QOS)
CLOCK = profile(topics.CLOCK_QOS)
