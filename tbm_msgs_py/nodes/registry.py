"""The nodes: what setup.py, launch files, the command line, the documentation and the tests know of them.

setup.py reads this file by its path, before anything is installed: it imports the standard library only.
"""

from typing import NamedTuple


class NodeEntry(NamedTuple):
    """A node, with the name of its executable.

    The module holds the class; the fields of the settings are its parameters; the extra is of the package it needs.
    """

    name: str
    module: str
    class_name: str
    settings: str
    summary: str
    extra: str = ""


NODES = {
    entry.name: entry
    for entry in (
        NodeEntry(
            "load_node",
            "tbm_dynamics.nodes.load_node",
            "LoadNode",
            "tbm_dynamics.nodes.settings.LoadSettings",
            "Loads on the cutterhead, in blocks.",
        ),
        NodeEntry(
            "dynamics_node",
            "tbm_dynamics.nodes.dynamics_node",
            "DynamicsNode",
            "tbm_dynamics.nodes.settings.DynamicsSettings",
            "The response to these loads.",
        ),
        NodeEntry(
            "analysis_node",
            "tbm_gsa.app.nodes.analysis_node",
            "AnalysisNode",
            "tbm_gsa.app.nodes.settings.AnalysisSettings",
            "Model against field, sensitivity analysis.",
        ),
        NodeEntry(
            "bag_player",
            "tbm_msgs_py.nodes.bag_player",
            "BagPlayer",
            "tbm_msgs_py.nodes.settings.PlayerSettings",
            "A recording onto its topics.",
        ),
        NodeEntry(
            "bag_recorder",
            "tbm_msgs_py.nodes.bag_recorder",
            "BagRecorder",
            "tbm_msgs_py.nodes.settings.RecorderSettings",
            "Topics into a recording.",
        ),
        NodeEntry(
            "live_view",
            "tbm_gsa.app.nodes.live_view",
            "LiveView",
            "tbm_gsa.app.nodes.settings.LiveViewSettings",
            "Topics for Foxglove.",
            extra="live",
        ),
        NodeEntry(
            "web_view",
            "tbm_gsa.app.nodes.web_view",
            "WebView",
            "tbm_gsa.app.nodes.settings.WebViewSettings",
            "A page to watch the machine on.",
            extra="web",
        ),
    )
}
MACHINE_NODES = ("load_node", "dynamics_node", "analysis_node")  # those that a machine runs
