"""Parameters of the analysis node."""

import os

from tbm_gsa.app.nodes.history_writer import OFF
from tbm_msgs_py import topics
from tbm_msgs_py.nodes.parameters import ROOT, Parameter

MOST_WORKERS = max(2, os.cpu_count() or 1)
PARAMETERS = (
    Parameter("machine", "dz101", "machine: name of a shipped one, or path of a machine file"),
    Parameter(
        "window", topics.WINDOW, "length of a comparison window (s)", minimum=0.1, maximum=3600.0, changes="running"
    ),
    Parameter(
        "threshold",
        topics.ERROR_THRESHOLD,
        "relative error that counts (1)",
        minimum=0.001,
        maximum=100.0,
        changes="running",
    ),
    Parameter(
        "threshold_windows",
        topics.ERROR_WINDOWS,
        "windows in a row over the threshold that raise the alarm",
        minimum=1,
        maximum=10000,
        changes="running",
    ),
    Parameter(
        "alarm_axes", ["x"], "axes whose error is watched; the paper compares the axial one, x", changes="running"
    ),
    Parameter(
        "mapping", "", "mapping file of the field topics; empty: the topics of the contract, m/s², gravity removed"
    ),
    Parameter(
        "history",
        "",
        "history file of the windows; empty: tbm_monitor/history.sqlite in the user's data folder; none: not kept",
        written=True,
        no_path=("", OFF),
    ),
    ROOT,
    Parameter("history_days", 90.0, "age at which live windows go; 0: never (d)", minimum=0.0, maximum=36500.0),
    Parameter(
        "baseline",
        "",
        "baseline in the history whose errors alarms are set against; empty: the threshold is absolute",
        changes="running",
    ),
    Parameter("gsa.on_threshold", True, "start the sensitivity analysis when the alarm is raised", changes="running"),
    Parameter(
        "gsa.pause",
        60.0,
        "least time from the start of a study to one that an alarm starts (min)",
        minimum=0.0,
        maximum=100000.0,
        changes="running",
    ),
    Parameter("gsa.samples", 200, "training simulations", minimum=10, maximum=100000, changes="running"),
    Parameter("gsa.test", 20, "test simulations", minimum=2, maximum=100000, changes="running"),
    Parameter("gsa.duration", 3.0, "length of a simulation (s)", minimum=0.1, maximum=600.0, changes="running"),
    Parameter("gsa.outputs", [""], "outputs analysed; empty: the eight indicators of Table 3", changes="running"),
    Parameter("gsa.seed", 0, "seed of design and loads", minimum=0, maximum=2**31 - 1, changes="running"),
    Parameter("gsa.workers", 2, "processes, one a core at most", minimum=1, maximum=MOST_WORKERS, changes="running"),
    Parameter(
        "gsa.folder",
        "tbm_gsa_studies",
        "folder that gets one folder a study",
        changes="running",
        written=True,
        no_path=(),
    ),
)
