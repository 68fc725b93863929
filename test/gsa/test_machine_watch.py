"""Rock, machine or sensor, span by span; draws from the law of a machine whose band powers add."""

import numpy as np
import pytest
from added_powers import COUNT, added_powers, of_sensors, spans

from tbm_gsa.explanation.machine_watch import MachineWatch

MINUTE = 60_000_000_000
COMMISSIONED, SOUND = 40, 5


@pytest.fixture(scope="module")
def model():
    return added_powers()


def watched(machine, change, count=12):
    """States of a machine that is commissioned, is sound for a while on even rock and then changes."""
    watch = MachineWatch(machine, commissioning=COMMISSIONED, length=5000.0)
    rows = spans(machine, COMMISSIONED + SOUND + count, 21, np.ones(6))
    rows[COMMISSIONED + SOUND :] += change
    return [watch.add(number * MINUTE, row) for number, row in enumerate(rows)]


@pytest.mark.parametrize(
    ("places", "size", "kind", "text"),
    [
        ([3, 4, 5], np.log(1.5**2), "sensor", "sensor: gain at p1 x, factor "),
        ([3, 4, 5], np.log(1000.0**2), "sensor", "sensor: gain at p1 x, factor "),
        ([4, 7], -0.8, "machine", "machine: no single input explains it; farthest off: rms_"),
    ],
)
def test_an_alarm_says_what_and_since_when(model, places, size, kind, text):
    change = np.zeros(COUNT)
    change[places] = size
    states = watched(of_sensors(model), change)
    assert [state.commissioned for state in states[: COMMISSIONED + 1]] == [*range(1, COMMISSIONED + 1), COMMISSIONED]
    assert all(state.alarm is None for state in states[: COMMISSIONED + SOUND])
    alarm = states[-1].alarm
    assert alarm.kind == kind
    assert alarm.text.startswith(text)
    if alarm.sensor:
        assert alarm.sensor.gain == pytest.approx(np.exp(0.5 * size), rel=0.05)
    assert abs(alarm.since_ns / MINUTE - COMMISSIONED - SOUND) <= 3


def test_rougher_rock_is_no_alarm_and_is_shown_as_rock(model):
    """All bands of one group of loads by a factor of two in amplitude."""
    watch = MachineWatch(model, commissioning=COMMISSIONED, length=5000.0)
    even, rough = np.ones(6), np.array([1.0, 2.0, 1.0, 1.0, 1.0, 1.0])
    rows = np.vstack([spans(model, COMMISSIONED + SOUND, 22, even), spans(model, 12, 23, rough)])
    states = [watch.add(number * MINUTE, row) for number, row in enumerate(rows)]
    assert all(state.alarm is None for state in states)
    loads = {one.name: one for one in states[-1].loads}
    changed = loads.pop("axial_high")
    assert changed.low < 2.0 < changed.high
    assert changed.probability > 0.99
    assert changed.since_ns == (COMMISSIONED + SOUND) * MINUTE
    assert all(one.low < 1.0 < one.high or one.probability < 0.99 for one in loads.values())


def test_an_alarm_ends_when_the_machine_is_what_it_was(model):
    sensors = of_sensors(model)
    watch = MachineWatch(sensors, commissioning=COMMISSIONED, length=5000.0)
    rows = spans(sensors, COMMISSIONED + 50, 24, np.ones(6))
    rows[COMMISSIONED : COMMISSIONED + 3, [4, 7]] += 1.5
    stands = [watch.add(number * MINUTE, row).alarm is not None for number, row in enumerate(rows)]
    assert stands[COMMISSIONED + 2]
    assert not stands[-1]
