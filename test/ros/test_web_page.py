"""The page in a real headless Chromium: what it shows of a machine whose nodes say this or that."""

import re

import pytest

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("aiohttp")

from browser import start_browser  # noqa: E402
from peer import Peer  # noqa: E402
from processes import wait_for  # noqa: E402
from web_scene import DEAD, MACHINE, POINTS, ROCK, Scene, healthy  # noqa: E402

from tbm_gsa.app.nodes.web_view import WebView  # noqa: E402
from tbm_gsa.app.web import gathering  # noqa: E402
from tbm_gsa.history import History  # noqa: E402

pytestmark = pytest.mark.ros


class Page:
    """The page in a browser, the node behind it, and the scene that it listens to."""

    def __init__(self, browser, folder):
        self.browser, self.history = browser, folder / "history.sqlite"
        self.folder = folder / "pages"
        self.folder.mkdir()
        self.peer = Peer().__enter__()
        self.scene = Scene(self.peer, self.history)
        self.scene.fill_history(0.2)
        self.host(0)

    def host(self, port):
        self.hosted = self.peer.host(WebView, port=port, history=self.history, folder=self.folder)
        self.hosted.asked_only = True
        self.node, self.port = self.hosted.node, self.hosted.node._server.port
        self.scene.lock = self.node._trends.lock

    def open(self):
        self.browser.get(f"http://127.0.0.1:{self.port}/")

    def look(self):
        """Let the node hear what is on its way, and show it."""
        self.peer.settle()
        self.node.look()

    def run(self, script, *arguments):
        return self.browser.execute_script(script, *arguments)

    def text(self, chosen):
        return self.run("return document.querySelector(arguments[0])?.textContent ?? ''", chosen)

    def shows(self, chosen, text):
        """Wait until a place of the page has a text in it."""
        wait_for(lambda: text in self.text(chosen), step=self.peer.spin)

    def keep(self, say, condition):
        """Say something again and again until the page has it."""
        wait_for(condition, step=lambda: [say(), self.look(), self.peer.spin()])

    def tree(self):
        """Accessibility tree of Chromium: (role, name) of what a screen reader finds."""
        nodes = self.browser.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]
        told = [one for one in nodes if not one["ignored"]]
        return [(one.get("role", {}).get("value"), one.get("name", {}).get("value", "")) for one in told]

    def complaints(self):
        return [line["message"] for line in self.browser.get_log("browser") if line["level"] == "SEVERE"]

    def close(self):
        self.hosted = self.node = self.scene = None  # or their participant would outlive the peer's end
        self.peer.__exit__(None, None, None)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    started = start_browser(tmp_path_factory.mktemp("chromium"))
    yield started
    started.quit()


@pytest.fixture(scope="module")
def page(browser, tmp_path_factory):
    """One for all cases: each says all over again how the machine is, and nothing grows old on a busy computer."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(gathering, "LOST_S", 1e6)
        patched.setattr(gathering, "QUIET_S", 1e6)
        made = Page(browser, tmp_path_factory.mktemp("page"))
        healthy(made.scene)
        made.open()
        yield made
        made.close()


def test_a_healthy_machine_is_all_well(page):
    healthy(page.scene)
    page.scene.samples(3)
    page.look()
    page.shows("#title", "All well")
    assert page.run("return document.querySelector('#verdict').dataset.kind") == "well"
    page.shows("#levels tbody", "as expected")
    heads = [page.text(f"#levels tbody tr:nth-child({place}) th") for place in range(1, 6)]
    assert heads == [f"{place}{point}" for place, point in enumerate(POINTS, 1)]
    page.keep(page.scene.drives, lambda: page.text("#drives tbody").count("drive ") == 10)  # live: best effort
    page.shows("#cursor", "14.19 Hz, mesh frequency: measured 0.")
    assert "ring 412" in page.text("#operation")
    assert page.complaints() == []


@pytest.mark.parametrize(
    ("event", "kind", "title", "point", "state"),
    [
        (ROCK, "rock", "Rock changed", "", ""),
        (MACHINE, "machine", "Machine changed", "", ""),
        (DEAD, "sensor", "Sensor: walkway", "walkway", "dead"),
    ],
)
def test_what_stands_is_said_in_words(page, event, kind, title, point, state):
    healthy(page.scene)
    page.scene.events(event)
    page.look()
    page.shows("#title", title)
    assert event.text in page.text("#text")
    assert page.run("return document.querySelector('#verdict').dataset.kind") == kind
    assert re.search(r"since .*\(\d\d min ago\)", page.text("#since"))
    page.shows("#events tbody tr", "stands")
    if point:
        page.shows(f"#levels tbody tr:nth-child({POINTS.index(point) + 1}) .state", state)


def test_killed_nodes_are_missing_by_name(page, monkeypatch):
    healthy(page.scene)
    page.scene.nodes()
    with monkeypatch.context() as patched:
        patched.setattr(gathering, "LOST_S", -1.0)
        page.look()
        page.shows("#title", "No data: no node is heard")
    page.look()
    page.shows("#title", "All well")


def test_an_event_is_acknowledged_in_the_page(page):
    healthy(page.scene)
    page.scene.events(DEAD)
    page.look()
    page.shows("#title", "Sensor")
    page.run("document.querySelector('#events button').click()")
    page.run("document.querySelector('#ack-by').value = 'Anna'")
    page.run("document.querySelector('#ack-comment').value = 'cable\\n<b>replaced</b>'")
    page.run("document.querySelector('#ack-send').click()")
    page.shows("#events tbody tr", "Anna")
    with page.scene.lock, History(page.history) as history:
        (newest,) = history.events(newest=1)
    assert (newest.acknowledged_by, newest.comment) == ("Anna", "cable <b>replaced</b>")


def test_the_keyboard_moves_the_cursor_from_mark_to_mark(page):
    healthy(page.scene)
    page.scene.samples(3)
    keys = pytest.importorskip("selenium.webdriver.common.keys").Keys
    canvas = page.browser.find_element("id", "spectrum")
    for key, text in (
        (keys.HOME, "14.19 Hz, mesh frequency"),
        (keys.PAGE_UP, "23.37 Hz, motor shaft"),
        (keys.PAGE_DOWN, "14.19 Hz, mesh frequency"),
        (keys.ARROW_RIGHT, "14.69 Hz"),
        (keys.END, "150 Hz"),
    ):
        canvas.send_keys(key)
        page.shows("#cursor", text)
        assert text in canvas.get_attribute("aria-valuetext")


def test_a_machine_that_slows_down_moves_its_lines(page):
    healthy(page.scene)
    own = page.scene.machine.operating_point.speed
    for speed, title in ((0.5 * own, "All well"), (0.0, "Not boring")):
        page.scene.drive(speed)
        page.node._lines_due = 0.0
        page.look()
        page.shows("#title", title)
        page.shows("#mark", "7.093 Hz mesh frequency")
    page.scene.drive()
    page.node._lines_due = 0.0
    page.look()
    page.shows("#mark", "14.19 Hz mesh frequency")


def test_a_screen_reader_finds_everything(page):
    healthy(page.scene)
    page.look()
    page.shows("#title", "All well")
    tree = page.tree()
    for landmark in ("banner", "main"):
        assert [role for role, _ in tree].count(landmark) == 1
    regions = [name for role, name in tree if role == "region"]
    for name in ("Verdict", "Levels along the machine", "Trend", "Events", "Load sharing of the drives"):
        assert name in regions
    assert all(
        name for role, name in tree if role in ("button", "link", "table", "radio", "slider", "combobox", "image")
    )
    assert ("slider", "Frequency cursor") in tree
    assert "All well" in [name for role, name in tree if role == "heading"]


@pytest.mark.parametrize("width", [360, 1920])
def test_the_page_fits_a_phone_and_a_wall(page, width):
    size = {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": width < 600}
    page.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    healthy(page.scene)
    page.look()
    page.shows("#title", "All well")
    assert page.run("return document.documentElement.scrollWidth") <= width
    page.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_the_page_comes_back_after_a_restart(page):
    page.hosted.close()
    page.shows("#link", "no connection since")
    page.shows("#title", "No connection to the monitor")
    page.host(page.port)
    healthy(page.scene)
    page.scene.events(ROCK)
    page.look()
    page.shows("#link", "live")
    page.shows("#title", "Rock changed")


def test_a_node_that_hangs_is_no_connection(page):
    """Its server answers, with what was true once: a page that is opened again is not deceived either."""
    healthy(page.scene)
    page.look()
    page.shows("#title", "All well")
    timers = list(page.node.timers)
    for timer in timers:
        timer.cancel()
    page.shows("#link", "live")
    page.run("const now = Date.now; Date.now = () => now() + 20000")
    page.shows("#title", "No connection to the monitor")
    sent = page.node._server.sent_bytes
    wait_for(lambda: page.node._server.sent_bytes > sent)  # it is connected again, and has got the old word
    assert page.text("#title") == "No connection to the monitor"
    for timer in timers:
        timer.reset()
    page.shows("#title", "All well")


def test_pages_of_the_run_are_linked_and_run_no_script(page):
    script = "<script>document.title = 'run'</script>"
    (page.folder / "study.html").write_text(f"<title>Study &amp; more</title>{script}<p style='color: red'>kept</p>")
    (page.folder / "link.html").symlink_to("/etc/passwd")
    page.open()
    page.shows("#pages", "Study & more")
    assert page.run("return document.querySelectorAll('#pages a').length") == 1
    page.browser.get(page.run("return document.querySelector('#pages a').href"))
    assert page.browser.title == "Study & more"
    assert page.text("p") == "kept"
