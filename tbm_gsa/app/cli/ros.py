"""Import of the ROS side, for the commands that need it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from tbm_gsa.app.nodes.watch import Watch

LOAD_NODE = "tbm_dynamics.nodes.load_node"
DYNAMICS_NODE = "tbm_dynamics.nodes.dynamics_node"
ANALYSIS_NODE = "tbm_gsa.app.nodes.analysis_node"
LIVE_VIEW = "tbm_gsa.app.nodes.live_view"
BAG_PLAYER = "tbm_msgs_py.nodes.bag_player"
BAG_RECORDER = "tbm_msgs_py.nodes.bag_recorder"
SENDER = "tbm_gsa.app.nodes.exchange"
SAID = frozenset({"tbm: loads", "tbm: dynamics", "tbm: history"})
"""Statuses on `/diagnostics` by which each of the three nodes says, once a second, that it is active."""


def watch(points: Iterable[str]) -> Watch:
    """Watch over the running system.

    Raises
    ------
    click.UsageError
        There is no ROS 2 here.
    """
    try:
        from tbm_gsa.app.nodes.watch import Watch  # noqa: PLC0415 - only these commands need ROS
    except ImportError as error:
        raise typer.BadParameter(
            f"ROS 2 is not installed here ({error}); install ros-jazzy-rclpy or source a workspace"
        ) from None
    return Watch(points)
