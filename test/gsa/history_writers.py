"""What several processes write into one history file; a module of its own, which a process loads without the tests."""

from tbm_gsa.history import History, HistoryEntry, WindowSource

START = 1_700_000_000_000_000_000
LENGTH = 2_000_000_000


def entry(number, point="shield", axis="x", error=0.2):
    return HistoryEntry(point, axis, START + number * LENGTH, LENGTH, 1.0, 1.2, error, 1.0)


def write(path, number):
    with History(path) as opened:
        for place in range(50):
            opened.add(WindowSource("live", f"node {number}", "", "dz101", ""), [entry(place)])
