"""The server of the page, without a browser and without nodes: whom it lets in, and what clients can do to it."""

import http.client
import json
import re
import socket
from contextlib import ExitStack, closing

import pytest
from hypothesis import given, settings
from hypothesis.provisional import domains
from hypothesis.strategies import integers, ip_addresses

pytest.importorskip("aiohttp")
client = pytest.importorskip("websockets.sync.client")

from websockets.exceptions import InvalidStatus  # noqa: E402

from tbm_gsa.app.web import server as served  # noqa: E402
from tbm_gsa.app.web.guarding import refusal  # noqa: E402
from tbm_gsa.app.web.server import WebServer  # noqa: E402
from tbm_gsa.app.web.state import LinkedPage, PageList, Waterfall  # noqa: E402
from tbm_gsa.reading import Part  # noqa: E402
from tbm_msgs_py.base.errors import InputError  # noqa: E402


class Count(Part):
    """A section that is easy to tell from others."""

    number: int
    filling: str = ""


class Site:
    """Says what it was asked."""

    def __init__(self):
        self.asked = []

    def waterfall(self, point):
        return Waterfall(point=point, rows=())

    def drawing(self):
        raise RuntimeError("no figure")

    def pages(self):
        return PageList(pages=(LinkedPage(key="k", title="t", file="f", written="w"),))

    def page(self, key):
        return "<p>study</p>" if key == "k" else None

    def acknowledge(self, asked):
        self.asked.append(asked)
        raise InputError("event 3: acknowledged by Anna already")


@pytest.fixture
def server():
    with closing(WebServer("127.0.0.1", 0, Site(), frozenset({"tbm.site"}))) as made:
        yield made


def ask(server, path="/", method="GET", body=None, **headers):
    """Answer of the server; underscores of header names are hyphens."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    connection.putrequest(method, path, skip_host="Host" in headers)
    if body is not None:
        connection.putheader("Content-Length", str(len(body)))
    for name, value in headers.items():
        connection.putheader(name.replace("_", "-"), value)
    connection.endheaders(body)
    answer = connection.getresponse()
    answer.body = answer.read()
    connection.close()
    return answer


def connect(server, **options):
    return client.connect(f"ws://127.0.0.1:{server.port}/live", compression=None, **options)


def number(connection):
    return json.loads(connection.recv(30.0))["content"]["number"]


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Host": "localhost:{port}"}, 200),
        ({"Host": "127.0.0.1:{port}"}, 200),
        ({"Host": "[::1]:{port}"}, 200),
        ({"Host": "192.168.7.9"}, 200),
        ({"Host": "TBM.site:{port}", "Origin": "http://tbm.site:{port}"}, 200),
        ({"Host": "evil.example:{port}"}, 403),
        ({"Host": "127.0.0.1.evil.example"}, 403),
        ({"Host": "localhost@evil.example"}, 403),
        ({"Host": "[::1"}, 403),
        ({"Host": ""}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "http://127.0.0.1:1"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "http://127.0.0.1:{port}"}, 200),
    ],
)
def test_only_the_page_itself_may_ask(server, headers, status):
    stated = {name: value.format(port=server.port) for name, value in headers.items()}
    answer = ask(server, **stated)
    assert answer.status == status, answer.body
    if status == 403:
        assert re.fullmatch(rb"(host|origin) .*, allowed: .*", answer.body)


@settings(max_examples=30)
@given(domains(), ip_addresses(), integers(1, 65535))
def test_a_name_of_others_is_no_address(name, address, port):
    shown = f"[{address}]" if address.version == 6 else f"{address}"
    assert refusal(f"{name}:{port}", None, frozenset({"localhost"}))
    assert not refusal(f"{shown}:{port}", f"http://{shown}:{port}", frozenset({"localhost"}))
    assert refusal(f"{shown}:{port}", f"http://{name}:{port}", frozenset({"localhost"}))


def test_a_foreign_page_gets_no_websocket(server):
    with pytest.raises(InvalidStatus, match="403"):
        connect(server, origin="http://evil.example")


@pytest.mark.parametrize("path", ["/", "/static/main.js", "/nowhere", "/static/..%2Fserver.py", "/pages/x", "/pages/k"])
def test_every_answer_forbids_what_is_not_its_own(server, path):
    answer = ask(server, path)
    policy = answer.headers["Content-Security-Policy"]
    assert answer.status == (404 if path in ("/nowhere", "/static/..%2Fserver.py", "/pages/x") else 200)
    assert "default-src 'none'" in policy and "frame-ancestors 'none'" in policy
    assert ("sandbox" in policy) == (path == "/pages/k")
    assert answer.headers["X-Content-Type-Options"] == "nosniff"


def test_nothing_of_the_page_is_of_elsewhere(server):
    for name, content in server._static.items():
        found = set(re.findall(rb"(?:https?|wss?)://[^\s\"'`$]+", content)) - {b"http://www.w3.org/2000/svg"}
        assert not found, name
        assert not re.search(rb"<script(?! type=\"module\" src)|\sstyle=|\son\w+=|innerHTML|eval\(", content), name


def test_late_clients_get_what_is_there(server):
    server.show("one", Count(number=1))
    server.show("two", Count(number=2))
    with connect(server) as late:
        assert {number(late), number(late)} == {1, 2}
        server.show("one", Count(number=3))
        assert number(late) == 3


def test_twenty_clients_get_the_newest(server):
    with ExitStack() as stack:
        clients = [stack.enter_context(connect(server)) for _ in range(20)]
        server.show("count", Count(number=7))
        assert [number(one) for one in clients] == [7] * 20
        assert server.clients == 20
    assert server.sent_bytes == 20 * len('{"section": "count", "content": {"number":7,"filling":""}}')


def test_a_slow_client_gets_fewer_states_and_the_newest(server):
    filling, count = "x" * 500_000, 200
    with connect(server, max_size=None, max_queue=1) as slow, connect(server, max_size=None) as fast:
        for place in range(count):
            server.show("count", Count(number=place, filling=filling))
            assert number(fast) == place
        found = [number(slow)]
        while found[-1] != count - 1:
            found.append(number(slow))
    assert found == sorted(found)
    assert len(found) < count


def dead_client(server):
    """Connection of a client that reads nothing once it is one."""
    dead = socket.create_connection(("127.0.0.1", server.port))
    head = f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    dead.sendall(f"{head}Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n".encode())
    assert b"101" in dead.recv(15)
    return dead


def test_a_client_that_does_not_read_holds_up_no_end(monkeypatch):
    monkeypatch.setattr(served, "_END_S", 0.05)
    server = WebServer("127.0.0.1", 0, Site())
    with dead_client(server), connect(server, max_size=None) as fast:
        for place in range(12):
            server.show("count", Count(number=place, filling="x" * 500_000))
            assert number(fast) == place
        assert server.clients == 2
        server.close()


def test_a_client_that_does_not_read_is_closed(server, monkeypatch):
    monkeypatch.setattr(served, "PATIENCE_S", 0.05)
    with dead_client(server), connect(server, max_size=None) as fast:
        place = 0
        while place < 3 or server.clients > 1:
            server.show("count", Count(number=place, filling="x" * 500_000))
            assert number(fast) == place
            place += 1


def test_more_clients_than_there_may_be_are_refused(server, monkeypatch):
    monkeypatch.setattr(served, "MOST_CLIENTS", 1)
    with connect(server), pytest.raises(InvalidStatus, match="503"):
        connect(server)


def test_a_server_takes_the_place_of_one_that_ended(server):
    with connect(server) as before:
        server.show("count", Count(number=1))
        assert number(before) == 1
        with pytest.raises(InputError, match=rf"127\.0\.0\.1:{server.port}: "):
            WebServer("127.0.0.1", server.port, Site())
        server.close()
        with closing(WebServer("127.0.0.1", server.port, Site())) as again, connect(again) as after:
            again.show("count", Count(number=2))
            assert number(after) == 2
            assert again.token != server.token
    server.close = lambda: None


@pytest.mark.parametrize(
    ("body", "status", "text"),
    [
        (b'{"id": 3, "by": "Anna", "comment": "seen"}', 400, "event 3: acknowledged by Anna already"),
        (b'{"id": "3", "by": "Anna"}', 400, "id: Input should be a valid integer"),
        (b'{"id": 3, "by": "Anna", "else": 1}', 400, "else: no keys of Acknowledgement"),
        (b"no json", 400, "Invalid JSON"),
        (b"x" * 100_000, 413, "Maximum request body size"),
    ],
)
def test_what_cannot_be_acknowledged_is_one_line(server, body, status, text):
    answer = ask(server, "/events", "POST", body, X_Tbm_Token=server.token)
    assert (answer.status, text in answer.body.decode()) == (status, True), answer.body
    assert b"\n" not in answer.body


def test_what_nothing_expects_is_a_fault_in_one_line(server, capfd):
    assert ask(server, "/drawing.svg").status == 500
    assert server.problem == "GET /drawing.svg: RuntimeError: no figure"
    assert ask(server).status == 200
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("sent", [b"\x00\xff" * 50 + b"\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b"GET /" + b"x" * 20_000])
def test_noise_is_refused_without_a_word_in_the_log(server, sent, capfd):
    with socket.create_connection(("127.0.0.1", server.port), timeout=30.0) as noisy:
        noisy.sendall(sent)
        assert b" 400 " in noisy.recv(100)
    assert ask(server).status == 200
    assert capfd.readouterr() == ("", "")


def test_nothing_is_written_without_the_token_of_the_page(server):
    for headers in ({}, {"X_Tbm_Token": "x"}, {"X_Tbm_Token": "é"}, {"Origin": "http://evil.example"}):
        answer = ask(server, "/events", "POST", b'{"id": 3, "by": "Anna"}', **headers)
        assert answer.status == 403
    assert server._site.asked == []
