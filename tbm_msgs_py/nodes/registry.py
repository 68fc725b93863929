"""The nodes: what setup.py, launch files, the command line, the documentation and the tests know of them.

setup.py reads this file by its path, before anything is installed: it imports the standard library only.
"""

from typing import NamedTuple


class NodeEntry(NamedTuple):
    """A node, with the name of its executable.

    The module holds the class, and what the node declares as `PARAMETERS`; the extra is that of the package it needs.
    """

    name: str
    module: str
    class_name: str
    summary: str
    extra: str = ""


NODES = {
    entry.name: entry
    for entry in (
        NodeEntry("load_node", "tbm_dynamics.nodes.load_node", "LoadNode", "Loads on the cutterhead, in blocks."),
        NodeEntry("dynamics_node", "tbm_dynamics.nodes.dynamics_node", "DynamicsNode", "The response to these loads."),
        NodeEntry(
            "analysis_node",
            "tbm_gsa.app.nodes.analysis_node",
            "AnalysisNode",
            "Model against field, sensitivity analysis.",
        ),
        NodeEntry("bag_player", "tbm_msgs_py.nodes.bag_player", "BagPlayer", "A recording onto its topics."),
        NodeEntry("bag_recorder", "tbm_msgs_py.nodes.bag_recorder", "BagRecorder", "Topics into a recording."),
        NodeEntry("live_view", "tbm_gsa.app.nodes.live_view", "LiveView", "Topics for Foxglove.", extra="live"),
    )
}
MACHINE_NODES = ("load_node", "dynamics_node", "analysis_node")  # those that a machine runs
