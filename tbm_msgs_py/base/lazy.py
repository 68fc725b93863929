"""Names of a package that are imported on first use: what needs one of them does not wait for the others."""

from collections.abc import Callable, Mapping
from importlib import import_module


def lazy_names(package: str, homes: Mapping[str, str]) -> Callable[[str], object]:
    """`__getattr__` of a package whose names are at home in its modules.

    Parameters
    ----------
    package : str
    homes : mapping of str to str
        Names, separated by spaces, by their module.
    """
    home = {name: module for module, names in homes.items() for name in names.split()}

    def found(name: str) -> object:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(home[name]), name)

    return found
