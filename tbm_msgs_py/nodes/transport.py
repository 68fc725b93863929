"""How Fast DDS carries messages between processes of one computer: UDP on loopback.

Its own choice is shared memory. A process that is killed may leave a lock or a port behind there, at which the others
stand for seconds (`benchmarks/killed_readers.py`). Nodes here go on when one of them is killed, and their blocks come
no later over UDP.
"""

import os
from pathlib import Path

LOOPBACK = Path(__file__).with_name("loopback.xml")
DISCOVERY_RANGE, _IMPLEMENTATION = "ROS_AUTOMATIC_DISCOVERY_RANGE", "RMW_IMPLEMENTATION"
_TRANSPORTS, _PROFILES = "FASTDDS_BUILTIN_TRANSPORTS", "FASTRTPS_DEFAULT_PROFILES_FILE"
# Whoever sets one of these knows how messages are to travel.
_STATED = (_TRANSPORTS, _PROFILES, "FASTDDS_DEFAULT_PROFILES_FILE", "ROS_STATIC_PEERS")


def avoid_shared_memory() -> None:
    """Carry the messages of this process and all it starts over UDP, unless the environment says how to carry them.

    Where the discovery range is this computer, our profile takes its place: to that range rmw_fastrtps adds shared
    memory of its own, and it listens on every network all the same.
    """
    implementation = os.environ.get(_IMPLEMENTATION) or "rmw_fastrtps_cpp"
    if not implementation.startswith("rmw_fastrtps") or any(os.environ.get(name) for name in _STATED):
        return
    if os.environ.get(DISCOVERY_RANGE) == "LOCALHOST":
        # By name: another implementation would know nothing of the profile, and be heard on the network.
        os.environ |= {_IMPLEMENTATION: implementation, DISCOVERY_RANGE: "SYSTEM_DEFAULT", _PROFILES: str(LOOPBACK)}
    else:
        os.environ[_TRANSPORTS] = "UDPv4"
