"""What a site is told of events: a command of its own, or an HTTP POST; nothing of it waits, or ends the node."""

from __future__ import annotations

import os
import queue
import shlex
import shutil
import signal
import subprocess
import threading
import urllib.error
import urllib.request
from contextlib import suppress
from http.client import HTTPException
from typing import Final

from tbm_gsa.history.event_list import ListedEvent
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.texts import LONGEST_NAME, shortened

TIMEOUT_S: Final = 10.0
"""After which a command is killed, and an address given up."""
MOST_WAITING: Final = 100
"""Events that wait while a command or an address is slow; later ones are not told."""


class SiteHook:
    """Tells a command, an address or both of every event, one after the other, in a thread of its own.

    The command is run without a shell and gets the event as JSON on stdin; the address gets it as the body of a POST.

    Parameters
    ----------
    command : str
        Program and arguments, with quotes as in a shell; empty for none.
    address : str
        http or https; empty for none.

    Raises
    ------
    InputError
        A program that there is not.
    """

    def __init__(self, command: str, address: str) -> None:
        self._command, self._address = shlex.split(command), address
        if self._command and shutil.which(self._command[0]) is None:
            raise InputError(
                f"parameter events.command: {self._command[0]}: no such program, allowed: one that may be run"
            )
        self._waiting: queue.Queue[bytes | None] = queue.Queue(MOST_WAITING)
        self._outcomes: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._running: subprocess.Popen[bytes] | None = None
        self._closed = False
        if command or address:
            threading.Thread(target=self._work, name="events", daemon=True).start()

    def tell(self, event: ListedEvent) -> None:
        """Tell of an event, later."""
        if not (self._command or self._address):
            return
        try:
            self._waiting.put_nowait(event.model_dump_json().encode())
        except queue.Full:
            self._outcomes.put(f"{MOST_WAITING} events wait to be told of; not told: {event.kind} {event.begin}")

    def outcomes(self) -> list[str]:
        """Outcomes since the last call, each why it failed, or empty."""
        found = []
        with suppress(queue.Empty):
            while True:
                found.append(self._outcomes.get_nowait())
        return found

    def close(self) -> None:
        """End it; an event that is being told of is broken off."""
        self._closed = True
        with suppress(queue.Full):
            self._waiting.put_nowait(None)
        running = self._running
        if running is not None:
            _kill(running)

    def _work(self) -> None:
        while (document := self._waiting.get()) is not None and not self._closed:
            if self._command:
                self._outcomes.put(self._run(document))
            if self._address:
                self._outcomes.put(self._post(document))

    def _run(self, document: bytes) -> str:
        """Why the command failed; empty if it did not."""
        name = f"events.command {self._command[0]}"
        try:
            self._running = subprocess.Popen(  # noqa: S603 - the site's own, stated at the start
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                start_new_session=True,
            )
        except OSError as error:
            return f"{name}: {error.strerror}"
        try:
            said = self._running.communicate(document, TIMEOUT_S)[1]
        except subprocess.TimeoutExpired:
            _kill(self._running)
            self._running.wait()
            return f"{name}: killed after {TIMEOUT_S:g} s"
        if code := self._running.returncode:
            last = said.decode(errors="replace").strip().rpartition("\n")[2]
            return shortened(f"{name}: exit code {code} {last}".rstrip(), LONGEST_NAME)
        return ""

    def _post(self, document: bytes) -> str:
        """Why the address did not take it; empty if it did."""
        name = f"events.post {self._address}"
        request = urllib.request.Request(  # noqa: S310 - http or https, as the settings check
            self._address, document, {"Content-Type": "application/json"}
        )
        try:
            with urllib.request.urlopen(request, timeout=TIMEOUT_S):  # noqa: S310
                return ""
        except urllib.error.HTTPError as error:
            return f"{name}: answered {error.code}"
        except (OSError, HTTPException) as error:
            return shortened(f"{name}: {getattr(error, 'reason', None) or error}", LONGEST_NAME)


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a command with what it has started, unless it has ended."""
    if process.poll() is None:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
