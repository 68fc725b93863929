"""What `/diagnostics` says of a comparison, in the order of what matters most."""

import numpy as np
import pytest

pytest.importorskip("diagnostic_msgs")

from diagnostic_msgs.msg import DiagnosticStatus

from tbm_gsa.comparison import WindowResult
from tbm_gsa.nodes.statuses import comparison_status


def window(model=1.0, field=1.0):
    return WindowResult("girder", 0, 2_000_000_000, np.ones(3), np.ones(3), np.zeros(3), model, field)


@pytest.mark.parametrize(
    ("latest", "alarm", "refused", "level", "message"),
    [
        (None, False, "", DiagnosticStatus.STALE, "no window yet"),
        (window(), False, "", DiagnosticStatus.OK, "compared"),
        (window(), True, "", DiagnosticStatus.WARN, "relative error over its threshold"),
        (window(field=0.0), False, "", DiagnosticStatus.STALE, "no signal of the field"),
        (window(model=0.0), True, "", DiagnosticStatus.STALE, "no signal of the model"),
        (window(), False, "block fields: none", DiagnosticStatus.ERROR, "block fields: none"),
    ],
)
def test_status_of_a_comparison(latest, alarm, refused, level, message):
    status = comparison_status("girder", latest, None, alarm, refused)
    assert (status.level, status.message) == (level, message)
    assert status.hardware_id == "girder"
