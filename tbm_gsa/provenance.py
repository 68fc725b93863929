"""Where numbers come from: the machine's file and the versions of what computed them."""

import hashlib
import platform
from importlib import resources
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from tbm_dynamics import Machine

PACKAGES = ("tbm_monitor", "numpy", "scipy", "scikit-learn", "SALib")


def machine_sha256(machine: Machine) -> str:
    """Digest of the file a machine came from, else of its description."""
    shipped = resources.files("tbm_dynamics") / "machines" / f"{machine.origin}.yaml"
    for file in (Path(machine.origin), shipped):
        if file.is_file():
            return hashlib.sha256(file.read_bytes()).hexdigest()
    return hashlib.sha256(machine.base.model_dump_json().encode()).hexdigest()


def package_versions() -> dict[str, str]:
    """Versions of Python and of what the numbers come from; packages that are not installed are left out."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # run from the source tree
            continue
    return found
