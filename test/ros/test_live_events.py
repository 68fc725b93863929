"""Events of the analysis node: faults of signals from begin to end, on the topic, in the history, told to the site."""

import json
import sys
from http.server import BaseHTTPRequestHandler, HTTPServer
from threading import Thread

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from peer import SimulatedClock  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402

from tbm_gsa.app.nodes import event_keeper, site_hook  # noqa: E402
from tbm_gsa.app.nodes.analysis_node import AnalysisNode  # noqa: E402
from tbm_gsa.app.nodes.event_keeper import EventKeeper, Finding  # noqa: E402
from tbm_gsa.app.nodes.history_writer import HistoryWriter  # noqa: E402
from tbm_gsa.app.nodes.settings import AnalysisSettings  # noqa: E402
from tbm_gsa.app.nodes.site_hook import SiteHook  # noqa: E402
from tbm_gsa.history import Context, History, WindowSource  # noqa: E402
from tbm_gsa.history.event_list import ListedEvent  # noqa: E402
from tbm_msgs_py import ACCELERATION, read_acceleration  # noqa: E402
from tbm_msgs_py.base.errors import InputError  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402
from tbm_msgs_py.nodes.parameters import ParameterError, read_settings  # noqa: E402

pytestmark = pytest.mark.ros

SECOND, START = 10**9, 1_700_000_000 * 10**9
SOURCE = WindowSource("live", "/tbm/analysis_node", "", "dz101", "ab" * 32)
SILENT = Finding("silent", "girder", "error", "sensor", "no signal of the field")


class Kept:
    """A keeper, what it told, and looks of one second each."""

    def __init__(self, file):
        self.writer, self.told, self.now = HistoryWriter(str(file), SOURCE, print), [], START
        self.keeper = EventKeeper(
            self.writer, lambda _: Context(ring=7), lambda event: f"/{event.kind}", self.told.append
        )

    def look(self, *found, seconds=1, kind="live"):
        for _ in range(seconds):
            self.keeper.update(found, lambda key: key[1] == "girder", self.now, kind)
            self.listed = self.keeper.poll()
            self.now += SECOND
        return [(one.begin[17:19], one.end and one.end[17:19], one.kind) for one in self.listed]


def test_what_flickers_is_one_event(tmp_path):
    kept = Kept(tmp_path / "h.sqlite")
    assert kept.look(SILENT) == [("20", None, "silent")]
    kept.look(seconds=9)
    kept.look(SILENT, seconds=2)
    assert kept.look(seconds=10)[-1][1] is None
    assert kept.look() == [("20", "32", "silent")]
    assert [(one.end, one.id, one.ring, one.snapshot) for one in kept.told] == [
        (None, 1, 7, "/silent"),
        ("2023-11-14T22:13:32.000Z", 1, 7, "/silent"),
    ]
    assert kept.look(SILENT)[-1] == ("43", None, "silent")


def test_an_event_goes_on_after_a_restart(tmp_path):
    kept = Kept(tmp_path / "h.sqlite")
    dead = Finding("dead", "shield", "error", "sensor", "nothing along x")
    kept.look(SILENT, dead)
    kept.look(Finding("lost", "girder", "warning", "", "holes"), SILENT, kind="replay")
    kept.keeper.close(kept.now)
    kept.writer.close()
    again = Kept(tmp_path / "h.sqlite")
    found = again.look(SILENT)
    assert found == [("20", None, "silent"), ("20", None, "dead"), ("21", "22", "lost")]
    assert not again.told  # nothing has begun
    again.look(seconds=11)  # the shield is not looked at: nothing is known of it
    assert [one.end is None for one in again.listed] == [False, True, False]


def test_events_of_a_locked_or_no_history_are_kept(tmp_path):
    nowhere = Kept("none")
    nowhere.look(SILENT)
    assert nowhere.look(seconds=11) == [("20", "21", "silent")]
    assert nowhere.told[0].id is None
    kept = Kept(tmp_path / "h.sqlite")
    with History(tmp_path / "h.sqlite", wait_s=0.0) as other:
        other._connection.execute("BEGIN EXCLUSIVE")
        assert kept.look(SILENT) == [("20", None, "silent")]
        other._connection.execute("ROLLBACK")
        kept.look(SILENT)
        assert [one.number for one in other.events()] == [1]
        other.acknowledge([1], "Anna", "cable", 0)
        kept.look(SILENT)
    assert (kept.listed[0].id, kept.listed[0].acknowledged_by) == (1, "Anna")


class Told(BaseHTTPRequestHandler):
    """Keeps what is posted, and answers as its server is told to."""

    def do_POST(self):
        self.server.bodies.append(self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(self.server.answer)
        self.end_headers()

    def log_message(self, *_):
        """Nothing."""


@pytest.fixture
def site():
    server = HTTPServer(("127.0.0.1", 0), Told)
    server.bodies, server.answer = [], 200
    thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


def outcome(hook):
    """What came of the next event; the thread of the hook has it when it is done."""
    return hook._outcomes.get(timeout=30.0)


def event():
    kept = Kept("none")
    kept.look(SILENT)
    return kept.told[0]


def test_the_site_is_told_without_a_shell(tmp_path, site, monkeypatch):
    out = tmp_path / "a; touch b"
    program = "import sys, pathlib; pathlib.Path(sys.argv[1]).write_text(sys.stdin.read())"
    hook = SiteHook(f"{sys.executable} -c '{program}' '{out}'", f"http://127.0.0.1:{site.server_port}/events")
    hook.tell(event())
    assert [outcome(hook), outcome(hook)] == ["", ""]
    assert ListedEvent.model_validate_json(out.read_text()) == event()
    assert json.loads(site.bodies[0])["text"] == "no signal of the field"
    assert [path.name for path in tmp_path.iterdir()] == [out.name]
    hook.close()
    monkeypatch.setattr(site_hook, "TIMEOUT_S", 0.05)
    site.answer = 500
    for command, address, problem in (
        ("sh -c 'echo no route >&2; exit 3'", "", "events.command sh: exit code 3 no route"),
        ("sh -c 'sleep 61 & wait'", "", "events.command sh: killed after 0.05 s"),
        ("", f"http://127.0.0.1:{site.server_port}/", "answered 500"),
        ("", "http://127.0.0.1:1/", "Connection refused"),
    ):
        failing = SiteHook(command, address)
        failing.tell(event())
        assert problem in outcome(failing)
        failing.close()


def test_a_slow_hook_loses_events_and_says_so(monkeypatch):
    monkeypatch.setattr(site_hook, "MOST_WAITING", 2)
    hook = SiteHook("sleep 60", "")
    for _ in range(5):
        hook.tell(event())
    assert "2 events wait to be told of; not told: silent" in hook.outcomes()[-1]
    hook.close()


def test_a_silent_sensor_is_an_event_from_begin_to_end(host_node, peer, tmp_path, monkeypatch):
    monkeypatch.setattr(event_keeper, "HOLD_NS", SECOND // 2)
    out = tmp_path / "told"
    clock = SimulatedClock(peer, START)
    events = peer.listen(DiagnosticArray, "/tbm/analysis/events", qos.GSA)
    command = f"tee -a {out}"
    given = {
        "use_sim_time": True,
        "history": tmp_path / "h.sqlite",
        "window": 0.5,
        "snapshot.after": 0.2,
        "events.command": command,
    }
    node = host_node(AnalysisNode, **given)
    node.asked_only = True
    assert "read" in peer.set_parameters("/tbm/analysis_node", events__command="rm")[0]
    offsets = np.arange(250) / 1000.0
    makers = [peer.publisher(PointCloud2, f"/tbm/{side}/girder/block", qos.BLOCK) for side in ("model", "field")]

    def go(seconds, count):
        for _ in range(round(seconds / 0.25)):
            values = np.sin(2 * np.pi * 50.0 * (clock.now_ns * 1e-9 + offsets))[:, None] * [1.0, 1.0, 1.0]
            for maker in makers[:count]:
                maker.publish(messages.block(ACCELERATION, clock.now_ns, offsets, values))
            clock.tick(0.25)

    def newest():
        return {pair.key: pair.value for pair in events[-1].status[-1].values} if events and events[-1].status else {}

    site = peer.publisher(DiagnosticArray, "/tbm/context", qos.GSA)

    def say(**said):
        site.publish(messages.diagnostics(clock.now_ns, [messages.status("site", "ok", "", said)]))
        peer.settle()

    say(ring=412, chainage="1234.5", rock_class="III", shift="")
    go(3.25, 2)
    say(ring="many")
    node.report()
    assert newest() == {}
    line = "context: ring 'many', allowed: a whole number; the last one stays"
    assert node.says(line) and line in peer.text("tbm: analysis_node")
    say(ring=413, rock_class="IV")
    node.node._comparison.health._received["girder", "field"] -= 3.0  # wall time in which nothing came
    go(0.25, 1)
    node.report()
    assert (newest()["kind"], newest()["point"], newest()["end"], newest()["source"]) == (
        "silent",
        "girder",
        "",
        "replay",
    )
    for _ in range(2):
        go(0.75, 2)
        node.report()
    assert newest()["end"] > newest()["begin"]
    with History(tmp_path / "h.sqlite") as history:
        contexts = {one.event.context for one in history.events()}
        assert contexts == {Context(413, rock_class="IV")}
        windows = [one.context for one in history.windows()]
        assert (windows[0], windows[-1]) == (Context(412, 1234.5, "III"), Context(413, rock_class="IV"))
    recorded = read_acceleration(newest()["snapshot"], topic="/tbm/field/girder/block")
    assert np.abs(recorded.values).max() == pytest.approx(1.0, abs=0.02)
    late = peer.listen(DiagnosticArray, "/tbm/analysis/events", qos.GSA)
    peer.wait_for(lambda: late)


def test_a_hook_that_cannot_be_is_one_line():
    with pytest.raises(InputError, match=r"parameter events\.command: no_such_program: no such program, allowed: "):
        SiteHook("no_such_program -x", "")
    for name, value, problem in (
        ("events.command", "sh 'c", "No closing quotation, allowed: a program and its arguments"),
        ("events.post", "ftp://x", "allowed: an address such as http://"),
    ):
        with pytest.raises(ParameterError, match=problem) as refused:
            read_settings(AnalysisSettings, {name: value})
        assert str(refused.value).startswith(f"parameter {name}: ")
