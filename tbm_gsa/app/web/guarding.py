"""Who may talk to the server, and what a browser may do with its pages."""

from __future__ import annotations

from ipaddress import ip_address
from typing import Final
from urllib.parse import urlsplit

OWN_CONTENT: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
REPORT_CONTENT: Final = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'; sandbox"
)
"""Of pages that reports have written: they hold their styles and pictures, and no script."""
HEADERS: Final = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
TOKEN_HEADER: Final = "X-Tbm-Token"  # noqa: S105 - the name of a header


def refusal(host: str, origin: str | None, names: frozenset[str]) -> str:
    """Why a request is refused, in one line; empty if it is not.

    A page of others that gives its own name the address of this computer (DNS rebinding) still states its name as the
    host: an address can be no such name.

    Parameters
    ----------
    host : str
        Header of the request.
    origin : str, optional
        Header, which browsers send with whatever writes, and with a websocket.
    names : frozenset of str
        Of this computer.
    """
    try:
        parts = urlsplit(f"//{host}")
        name, _ = (parts.hostname or "").lower(), parts.port
    except ValueError:
        name = ""
    if not (_is_address(name) or name in names):
        return f"host {host[:80]!r}, allowed: an address, or one of {', '.join(sorted(names))}"
    if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
        return f"origin {origin[:80]!r}, allowed: this page's own"
    return ""


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True
