"""What `/diagnostics` says of a comparison, in the order of what matters most."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("diagnostic_msgs")

from diagnostic_msgs.msg import DiagnosticStatus

from tbm_gsa.comparison import WindowResult
from tbm_gsa.nodes.health import Condition
from tbm_gsa.nodes.statuses import comparison_status


def window(model=1.0, field=1.0, rms=1.0):
    return WindowResult("girder", 0, 2_000_000_000, np.ones(3), np.full(3, rms), np.zeros(3), model, field)


REFUSED = Condition(refused=["block fields: none"], silent=["no signal of the model for 3 s"])
SILENT = Condition(silent=["no signal of the field for 3 s"])
DOUBT = Condition(doubts=["2 publishers"])


@pytest.mark.parametrize(
    ("latest", "alarm", "health", "level", "message"),
    [
        (None, False, Condition(), DiagnosticStatus.STALE, "no window yet"),
        (window(), False, Condition(), DiagnosticStatus.OK, "compared"),
        (window(), True, Condition(), DiagnosticStatus.WARN, "relative error over its threshold"),
        (window(field=0.0), False, Condition(), DiagnosticStatus.STALE, "no signal of the field"),
        (window(model=0.0), True, Condition(), DiagnosticStatus.STALE, "no signal of the model"),
        (window(), True, SILENT, DiagnosticStatus.STALE, "no signal of the field for 3 s"),
        (
            window(),
            True,
            REFUSED,
            DiagnosticStatus.ERROR,
            "block fields: none; no signal of the model for 3 s",
        ),
        (window(), True, DOUBT, DiagnosticStatus.WARN, "relative error over its threshold; 2 publishers"),
        (window(field=0.5), False, Condition(), DiagnosticStatus.WARN, "field covers 50% of the window"),
        (
            window(rms=1.3 / 9.80665),
            False,
            Condition(),
            DiagnosticStatus.WARN,
            "field is about 0.102 times the model on all axes: values in g?",
        ),
        (
            window(rms=0.009),
            False,
            Condition(),
            DiagnosticStatus.WARN,
            "field measures next to nothing along x, y, z: a dead channel?",
        ),
        (
            replace(window(rms=0.009), operation="standstill"),
            False,
            Condition(),
            DiagnosticStatus.OK,
            "not compared: the machine stands still",
        ),
    ],
)
def test_status_of_a_comparison(latest, alarm, health, level, message):
    status = comparison_status("tbm: comparison girder", "girder", latest, None, alarm, health)
    assert (status.level, status.message) == (level, message)
    assert (status.name, status.hardware_id) == ("tbm: comparison girder", "girder")
