"""What every test may rely on."""

import os
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# One BLAS thread, as the command line and its processes have it: sums over more threads differ in their last bit.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from tbm_msgs_py.nodes.transport import LOOPBACK, avoid_shared_memory  # noqa: E402 - it imports numpy, which has its threads then


def _claim_domain() -> tuple[int, socket.socket]:
    """Domain that no other test process of this computer has while the socket is open.

    Up to 101 the ports of DDS (UDP) stay clear of the ephemeral range; the one bound here is the same number in TCP.
    """
    for domain in (1 + (os.getpid() + k) % 100 for k in range(100)):
        claim = socket.socket()
        try:
            claim.bind(("127.0.0.1", 7400 + 250 * domain))
        except OSError:
            claim.close()
        else:
            return domain, claim
    raise RuntimeError("all ROS domains from 1 to 100 are taken by other test processes")


_domain, _claim = _claim_domain()
os.environ["ROS_DOMAIN_ID"] = str(_domain)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
# As the nodes do, whatever the environment or the process that started this one has settled: a node that a test kills
# must not hold up the tests after it.
os.environ.pop("FASTRTPS_DEFAULT_PROFILES_FILE", None)
avoid_shared_memory()

_data = tempfile.TemporaryDirectory(prefix="tbm_test_data_")
# A test has several contexts in one process. Fast DDS would tell one of the writers of another by direct calls, and one
# that ends while the other is busy may wait for it for ever: seen once in some twenty runs, in the removal of a writer.
# The data themselves still go by direct calls. A process of a machine has one context.
_profiles = Path(_data.name) / "profiles.xml"
_profiles.write_text(
    f"<dds>{LOOPBACK.read_text(encoding='utf-8').partition('?>')[2]}"
    "<library_settings><intraprocess_delivery>USER_DATA_ONLY</intraprocess_delivery></library_settings></dds>",
    encoding="utf-8",
)
os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(_profiles)

# A busy computer draws slowly, too.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")

# What a test compares does not go into the history of whoever runs it.
os.environ["XDG_DATA_HOME"] = _data.name
os.environ.pop("TBM_HISTORY", None)

# A job in the background of a script inherits an ignored SIGINT, and so would every process that a test starts and
# interrupts. The ones under test are to behave as at a terminal.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def startup_cycles() -> Path:
    """Recorded start-up cycles of a hard-rock machine; they stay beside the checkout, no copy is in the project."""
    file = Path(__file__).parents[2] / "shared" / "data" / "tbm2_startup_cycles.csv"
    if not file.is_file():
        pytest.skip("the recorded start-up cycles are not beside this checkout")
    return file


@pytest.fixture(scope="session")
def machine():
    """The shipped machine; it is frozen, so that all tests share it."""
    from tbm_dynamics import load_machine

    return load_machine("dz101")


@pytest.fixture(scope="session")
def system(machine):
    return machine.assemble()


@pytest.fixture
def command(tmp_path):
    """Run a command to its end in an empty folder: exit code, stdout, stderr."""

    def run(*arguments, deadline=300.0):
        given = [sys.executable, "-m", "tbm_gsa.app.cli.main", *arguments]
        done = subprocess.run(given, cwd=tmp_path, capture_output=True, text=True, timeout=deadline, check=False)
        assert "Traceback" not in done.stderr, done.stderr
        return done.returncode, done.stdout, done.stderr

    return run


# Files that take ten seconds and more, the longest first: one that comes last leaves all workers but its own idle.
LONGEST = (
    "test_demo.py",
    "test_analysis_node.py",
    "test_run.py",
    "test_killed_nodes.py",
    "test_random_graph.py",
    "test_native.py",
    "test_bag_recorder.py",
    "test_time.py",
    "test_faults.py",
    "test_signals.py",
    "test_whole_system.py",
    "test_reproduction.py",
    "test_explanation.py",
    "test_gsa_command.py",
    "test_study.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first; the others stay as they are."""
    place = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.name, len(place)))
