"""Tests with real ROS 2 processes: conditions with a deadline, processes ended by id."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

COMPLAINTS = ("Traceback", "unexpected error")
DEADLINE = 300.0  # s; only what is stuck gets there, however busy the computer is


def wait_for(
    condition: Callable[[], object], deadline: float = DEADLINE, step: Callable[[], None] | None = None
) -> None:
    """Wait until a condition holds; `step` does some work in between, such as spinning a node."""
    end = time.monotonic() + deadline
    while not condition():
        assert time.monotonic() < end, f"condition not met within {deadline} s"
        if step is None:
            time.sleep(0.01)
        else:
            step()


class NodeProcess:
    """A node in a process of its own, its output in a file."""

    def __init__(self, log: Path, module: str, arguments: list[str]) -> None:
        self.log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "tbm_gsa.app.nodes.start", module, *arguments],
                stdout=output,
                stderr=subprocess.STDOUT,
            )

    @property
    def output(self) -> str:
        return self.log.read_text(errors="replace")

    def says(self, text: str) -> bool:
        return text in self.output

    def send(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def fault_at_end(self, deadline: float = DEADLINE) -> str:
        """What went wrong with the end that a signal asked for; killed by its id if it did not come."""
        try:
            code = self.process.wait(deadline)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            return f"did not end within {deadline} s of a signal:\n{self.output}"
        complains = any(complaint in self.output for complaint in COMPLAINTS)
        return f"exit code {code}:\n{self.output}" if code or complains else ""

    def exit_code(self, deadline: float = DEADLINE) -> int:
        return self.process.wait(deadline)


def ros_arguments(remapped: tuple[str, ...], parameters: dict[str, object]) -> list[str]:
    """What follows a node's name on its command line."""
    values = {name: str(value).lower() if isinstance(value, bool) else str(value) for name, value in parameters.items()}
    return ["--ros-args", *remapped, *(part for name, value in values.items() for part in ("-p", f"{name}:={value}"))]
