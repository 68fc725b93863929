"""Faults of the incoming signals, by test point."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from tbm_gsa.comparison import StreamCounters
from tbm_gsa.comparison.streams import SIDES, Side
from tbm_msgs_py.nodes.fault_log import FaultLog
from tbm_msgs_py.nodes.rate import Rate

SILENCE_S = 2.0  # wall time without a sample after which a signal is silent, and a refusal over
_COUNTED = {
    "rejected": "{} samples of the {} that are not finite or absurdly large",
    "late": "{} samples of the {} late or twice: ",
    "restarts": "{} jumps back of the stamps of the {}",
    "rate_changes": "{} changes of the rate of the {}: ",
}


_REMEDY = "a recording needs its own clock (run --sim-time), a sensor one that is set"


@dataclass
class Condition:
    """Findings at one test point, each a line.

    Attributes
    ----------
    refused : list of str
        Blocks that could not be used.
    doubts : list of str
        What is used, but is not right.
    silent : list of str
        Signals that have stopped.
    rates : dict of str to float
        Samples in a second of wall time, by signal.
    """

    refused: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    silent: list[str] = field(default_factory=list)
    rates: dict[str, float] = field(default_factory=dict)


class StreamHealth:
    """Gathers what blocks, publishers and counters show of every signal.

    Parameters
    ----------
    warn : callable
        Called with a line for the log.
    """

    def __init__(self, warn: Callable[[str], object]) -> None:
        self._faults: FaultLog[tuple[str, str, str]] = FaultLog(warn)
        self._received: dict[tuple[str, str], float] = {}
        self._refused: dict[tuple[str, str], float] = {}  # when last
        self._rates: dict[tuple[str, str], Rate] = {}
        self._counted: dict[tuple[str, Side, str], int] = {}
        self._publishers: dict[str, dict[str, list[str]]] = {}  # by point and topic
        self._apart: set[str] = set()  # points at the last call

    def add_samples(self, point: str, source: str, samples: int) -> None:
        """Add samples that are used."""
        self._received[point, source] = time.monotonic()
        self._rates.setdefault((point, source), Rate()).add(samples)
        self._accept(point, source)

    def _accept(self, point: str, source: str) -> None:
        if self._refused.pop((point, source), None) is not None:
            self._faults.clear(("refused", point, source))

    def refuse(self, point: str, source: str, reason: str) -> None:
        """Add samples that cannot be used: a fault until others come, or none for a while."""
        self._received.pop((point, source), None)
        self._refused[point, source] = time.monotonic()
        self._faults.report(("refused", point, source), f"{source} {point}: {reason}; not used")

    def doubt(self, point: str, key: str, text: str) -> None:
        """Report what is used, but is not right, until it is settled."""
        self._faults.report(("doubts", point, key), text, f"{point}: ")

    def note(self, point: str, key: str, text: str) -> None:
        """Report a doubt, or settle it where the text is empty."""
        if text:
            self.doubt(point, key, text)
        else:
            self.settle(point, key)

    def fail(self, point: str, topic: str, text: str) -> None:
        """Report a topic, or one of its publishers, that cannot be used, until it is settled."""
        self._faults.report(("refused", point, topic), text, f"{point}: ")

    def settle(self, point: str, key: str) -> None:
        """Mark a topic or a doubt as right."""
        for kind in ("refused", "doubts"):
            self._faults.clear((kind, point, key))

    def set_publishers(self, point: str, topic: str, nodes: list[str]) -> None:
        """Set the publishers of a field topic."""
        self._publishers.setdefault(point, {})[topic] = sorted(nodes)

    def conditions(
        self,
        counters: Mapping[str, Mapping[Side, StreamCounters]],
        clock_stands: bool,
        apart_ns: Mapping[str, int],
    ) -> dict[str, Condition]:
        """Return what was found since the last call, by test point; `apart_ns` is that of the `WindowedComparison`."""
        for (point, source), last in list(self._refused.items()):
            if time.monotonic() - last > SILENCE_S:
                self._accept(point, source)
        silences = self._silences(clock_stands)
        self._compare_stamps(apart_ns, silences)
        for point, sources in counters.items():
            for source, counts in sources.items():
                for name, text in _COUNTED.items():
                    self._compare(point, source, name, counts, text)
                self._compare_rates(point, source, counts)
        found: dict[str, Condition] = {}
        for (kind, point, _), text in self._faults.show().items():
            getattr(found.setdefault(point, Condition()), kind).append(text)
        for (point, source), silence in silences.items():
            found.setdefault(point, Condition()).silent.append(f"no signal of the {source} for {silence:.0f} s")
        for (point, source), rate in self._rates.items():
            found.setdefault(point, Condition()).rates[source] = rate.mean()
        return found

    def _compare_stamps(self, apart_ns: Mapping[str, int], silences: Mapping[tuple[str, str], float]) -> None:
        """Report stamps that are too far apart to be compared; for a call after a jump they may be."""
        before, self._apart = self._apart, set(apart_ns)
        for point in before | self._apart:
            both = all((point, source) in self._received and (point, source) not in silences for source in SIDES)
            if both and point in before & self._apart:
                ahead = apart_ns[point]
                away = f"{_span(abs(ahead) * 1e-9)} {'behind' if ahead > 0 else 'ahead of'} the model's"
                self.fail(point, "stamps", f"stamps of the field are {away}, not compared: {_REMEDY}")
            else:
                self.settle(point, "stamps")

    def _compare(self, point: str, source: Side, name: str, counts: StreamCounters, text: str) -> None:
        count = getattr(counts, name)
        more = count - self._counted.get((point, source, name), 0)
        self._counted[point, source, name] = count
        if more > 0 and not (name == "late" and point in self._apart):  # of windows that are long over
            details = {"late": self._cause(point), "rate_changes": f"{counts.declared_hz:.0f} Hz now"}
            self.doubt(point, f"{source} {name}", text.format(more, source) + details.get(name, ""))
        else:
            self.settle(point, f"{source} {name}")

    def _compare_rates(self, point: str, source: Side, counts: StreamCounters) -> None:
        if counts.block_gaps:
            rates = f"{counts.declared_hz:.0f} Hz declared, {counts.came_hz:.0f} Hz came"
            self.doubt(point, f"{source} pace", f"{counts.block_gaps} gaps between the blocks of the {source}: {rates}")
        else:
            self.settle(point, f"{source} pace")

    def _cause(self, point: str) -> str:
        """Why samples overlap. A publisher that was killed is listed for 20 s more: two are no fault by themselves."""
        for topic, nodes in self._publishers.get(point, {}).items():
            if len(nodes) > 1:
                return f"{len(nodes)} publishers on {topic}, {', '.join(nodes)}"
        return "another rate than declared, or two publishers?"

    def _silences(self, clock_stands: bool) -> dict[tuple[str, str], float]:
        now = time.monotonic()
        if clock_stands:  # a bag that pauses sends nothing
            self._received = dict.fromkeys(self._received, now)
        return {key: now - last for key, last in self._received.items() if now - last > SILENCE_S}


def _span(seconds: float) -> str:
    """Length of time in the unit that suits it."""
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"
