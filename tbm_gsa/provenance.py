"""Where numbers come from: the content of the machine file and the versions of what computed them."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

from tbm_gsa.reading import MachineFile

if TYPE_CHECKING:
    from tbm_dynamics import Machine

PACKAGES = ("tbm_monitor", "numpy", "scipy", "scikit-learn", "SALib")


def machine_sha256(machine: Machine) -> str:
    """Digest of what a machine file says: 64 hexadecimal digits, the same wherever a machine is named by them.

    Comments, the order of the keys and the place of the file do not change it; a stated default is no difference.
    """
    return hashlib.sha256(machine.base.model_dump_json().encode()).hexdigest()


def machine_file(machine: Machine) -> MachineFile:
    """Origin and digest of a machine, as results name them."""
    return MachineFile(origin=machine.origin, sha256=machine_sha256(machine))


def package_versions(packages: Iterable[str] = PACKAGES) -> dict[str, str]:
    """Versions of Python and of what the numbers come from; packages that are not installed are left out."""
    found = {"python": platform.python_version()}
    for package in packages:
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # run from the source tree
            continue
    return found


def versions_text(versions: Mapping[str, str]) -> str:
    """Versions in one line."""
    return ", ".join(f"{name} {number}" for name, number in versions.items())
