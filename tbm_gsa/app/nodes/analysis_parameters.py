"""Parameters of the analysis node."""

import os

from tbm_gsa.app.nodes.history_writer import OFF
from tbm_msgs_py import topics
from tbm_msgs_py.nodes.parameters import ROOT, Parameter, live_parameter

MOST_WORKERS = max(2, os.cpu_count() or 1)
HISTORY = "history file of the windows; empty: tbm_monitor/history.sqlite in the user's data folder; none: not kept"
BASELINE = "baseline in the history whose errors alarms are set against; empty: the threshold is absolute"
PAUSE = "least time from the start of a study to one that an alarm starts (min)"
MAPPING = "mapping file of the field topics; empty: the topics of the contract, m/s², gravity removed"
PARAMETERS = (
    Parameter("machine", "dz101", "machine: name of a shipped one, or path of a machine file"),
    live_parameter("window", topics.WINDOW, "length of a comparison window (s)", 0.1, 3600.0),
    live_parameter("threshold", topics.ERROR_THRESHOLD, "relative error that counts (1)", 0.001, 100.0),
    live_parameter(
        "threshold_windows", topics.ERROR_WINDOWS, "windows in a row over it that raise the alarm", 1, 10000
    ),
    live_parameter("alarm_axes", ["x"], "axes whose error is watched; the paper compares the axial one, x"),
    Parameter("mapping", "", MAPPING),
    Parameter("history", "", HISTORY, written=True, no_path=("", OFF)),
    ROOT,
    Parameter("history_days", 90.0, "age at which live windows go; 0: never (d)", 0.0, 36500.0),
    live_parameter("baseline", "", BASELINE),
    live_parameter("gsa.on_threshold", True, "start the sensitivity analysis when the alarm is raised"),
    live_parameter("gsa.pause", 60.0, PAUSE, 0.0, 100000.0),
    live_parameter("gsa.samples", 200, "training simulations", 10, 100000),
    live_parameter("gsa.test", 20, "test simulations", 2, 100000),
    live_parameter("gsa.duration", 3.0, "length of a simulation (s)", 0.1, 600.0),
    live_parameter("gsa.outputs", [""], "outputs analysed; empty: the eight indicators of Table 3"),
    live_parameter("gsa.seed", 0, "seed of design and loads", 0, 2**31 - 1),
    live_parameter("gsa.workers", 2, "processes, one a core at most", 1, MOST_WORKERS),
    live_parameter("gsa.folder", "tbm_gsa_studies", "folder that gets one folder a study", written=True, no_path=()),
)
