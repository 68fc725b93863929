"""The pictures of the page to watch: its five states, once in the dark and once on a phone, in a real Chromium.

python docs/images/make_web.py

What the nodes say is published by a peer, as the tests have it: a machine does not change on request.
"""

from __future__ import annotations

import base64
import io
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PIL import Image

from tbm_gsa.app.cli.processes import settle_ros_environment

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1] / "test" / "ros"))
LARGEST = 150_000  # bytes of a picture
COLOURS = 112
WIDE, PHONE = 1280, 390
SETTLE_S = 8.0  # longer than a node may be silent


class Studio:
    """A browser, and a page for each state."""

    def __init__(self, browser: Any) -> None:
        self._browser = browser

    def shoot(
        self, name: str, act: Callable[[Any], None], *views: tuple[str, int, int, bool], change: float = 1.0
    ) -> None:
        """Show a state and keep pictures of it: name, width, height, and whether it is dark."""
        from peer import Peer  # noqa: PLC0415 - in the tests' folder
        from web_scene import Scene, healthy  # noqa: PLC0415

        from tbm_gsa.app.nodes.web_view import WebView  # noqa: PLC0415 - ROS

        with tempfile.TemporaryDirectory(prefix=name) as folder, Peer() as peer:
            pages = Path(folder) / "run"
            pages.mkdir()
            (pages / "explanation.html").write_text("<title>What explains the alarm</title>")
            (pages / "report.html").write_text("<title>Sensitivity study</title>")
            scene = Scene(peer, Path(folder) / "history.sqlite")
            scene.fill_history(7 * 24.0, every_s=60.0, change=change)
            scene.fill_history(1.2, change=change)
            hosted = peer.host(WebView, port=0, history=scene._history, folder=pages)
            scene.lock = hosted.node._trends.lock
            healthy(scene)
            scene.samples(150, change=change)
            for file, *view in views:
                until = time.monotonic() + SETTLE_S
                while time.monotonic() < until:
                    act(scene)
                    peer.spin_for(0.5)
                self._picture(HERE / f"web_{file}.png", hosted.node._server.port, lambda: act(scene), *view)

    def _picture(self, file: Path, port: int, act: Callable[[], None], width: int, height: int, dark: bool) -> None:
        tell = self._browser.execute_cdp_cmd
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
        tell("Emulation.setDeviceMetricsOverride", size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        tell("Emulation.setEmulatedMedia", {"features": [scheme]})
        self._browser.get(f"http://127.0.0.1:{port}/")
        for _ in range(5):
            act()
            time.sleep(0.5)  # the server has a thread of its own, and the page a process
        clip = {"x": 0, "y": 0, "width": width, "height": height, "scale": 1}
        shot = tell("Page.captureScreenshot", {"captureBeyondViewport": True, "clip": clip})["data"]
        Image.open(io.BytesIO(base64.b64decode(shot))).convert("RGB").quantize(COLOURS).save(file, optimize=True)
        if (bytes_ := file.stat().st_size) > LARGEST:
            raise SystemExit(f"{file}: {bytes_} bytes, allowed: {LARGEST}")


def well(scene: Any) -> None:
    """Say that all is well."""
    scene.nodes()
    scene.drives()
    scene.windows(1)


def rock(scene: Any) -> None:
    """Let the rock be another one."""
    from web_scene import ROCK  # noqa: PLC0415

    well(scene)
    scene.watch(rock="changed: axial_low 1.62 (1.48 to 1.79)")
    scene.events(ROCK)


def machine(scene: Any) -> None:
    """Let something near the girder have changed."""
    from web_scene import MACHINE  # noqa: PLC0415

    scene.nodes()
    scene.drives()
    scene.watch(text=MACHINE.text, alarm=1)
    scene.windows(10, {"girder": 1.4})
    scene.events(MACHINE)


def sensor(scene: Any) -> None:
    """Let a sensor measure nothing."""
    from web_scene import DEAD  # noqa: PLC0415

    scene.nodes()
    scene.drives()
    scene.windows(10, {"walkway": 0.001})
    scene.events(DEAD)


def killed(scene: Any) -> None:
    """Let the dynamics be gone; the others go on."""
    scene.nodes("dynamics_node")


def main() -> None:
    """Make docs/images/web_*.png."""
    settle_ros_environment()
    from browser import start_browser  # noqa: PLC0415

    with tempfile.TemporaryDirectory(prefix="chromium") as profile:
        browser = start_browser(Path(profile))
        try:
            studio = Studio(browser)
            dark, phone = ("dark", WIDE, 1480, True), ("phone", PHONE, 1500, False)
            studio.shoot("well", well, ("well", WIDE, 2250, False), dark)
            studio.shoot("rock", rock, ("rock", WIDE, 520, False))
            studio.shoot("machine", machine, ("machine", WIDE, 900, False), phone, change=1.4)
            studio.shoot("sensor", sensor, ("sensor", WIDE, 520, False))
            studio.shoot("nodes", killed, ("nodes", WIDE, 520, False))
        finally:
            browser.quit()


if __name__ == "__main__":
    main()
