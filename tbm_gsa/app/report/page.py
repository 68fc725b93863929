"""Rendering of HTML pages that need nothing but themselves: no script, no remote content."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from tbm_dynamics import Machine, MachineError, load_machine
from tbm_gsa.app.report.machine_drawing import draw_machine
from tbm_gsa.app.report.svg import inline_svg
from tbm_gsa.provenance import machine_sha256
from tbm_gsa.reading import MachineFile


@dataclass(frozen=True)
class PageMachine:
    """A machine that a page is about: where its file is, a shipped machine by its name, and the digest of it."""

    name: str
    origin: str
    sha256: str

    @classmethod
    def of(cls, name: str, file: MachineFile) -> PageMachine:
        """Machine that a result names."""
        return cls(name, file.origin, file.sha256)


@dataclass(frozen=True)
class PageHead:
    """What stands above every page.

    Attributes
    ----------
    title, subtitle : str
    data : str
        When, or out of what, the data are.
    units : str
        Of the quantities that may be given in several.
    machines : tuple of PageMachine
        Drawn at the end of the page.
    """

    title: str
    subtitle: str
    data: str
    units: str
    machines: tuple[PageMachine, ...]


def render_page(template: str, head: PageHead, context: Mapping[str, object]) -> str:
    """Render a template of this folder; everything in the context is escaped."""
    always = {"head": head, "made": _now(), "drawn_machine": _drawn_machine}
    return _environment().get_template(template).render({**always, **context})


def recorded_at(begin: str, duration: float | None = None) -> str:
    """Say when a recording was made; an earlier version did not write its time down."""
    length = "" if duration is None else f", {duration:.6g} s"
    return f"recorded from {begin}{length}" if begin else f"recorded, the time is not stated{length}"


def embed_figure(figure: Figure, description: str) -> Markup:
    """Make an inline ``<svg>`` of a figure.

    Parameters
    ----------
    figure : Figure
    description : str
        What the figure shows, for those who cannot see it; another one for each figure of a page.
    """
    return Markup(inline_svg(figure, description))  # noqa: S704 - every text in it is escaped by ElementTree


def _now() -> str:
    """Time of the page; that of SOURCE_DATE_EPOCH where equal results are to give equal pages."""
    stamp = int(os.environ.get("SOURCE_DATE_EPOCH") or time.time())
    return datetime.fromtimestamp(stamp, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


@lru_cache(maxsize=8)
def machine_of(named: PageMachine) -> Machine | None:
    """Machine of a page, unless its file is gone or says something else by now."""
    try:
        machine = load_machine(named.origin)
    except MachineError:
        return None
    return machine if machine_sha256(machine) == named.sha256 else None


@lru_cache(maxsize=8)
def _drawn_machine(named: PageMachine) -> Markup | None:
    """Drawing of a machine that is at hand."""
    machine = machine_of(named)
    if machine is None:
        return None
    return embed_figure(draw_machine(machine), f"Side view and drives of machine {named.name}, {named.sha256[:8]}")


@lru_cache(maxsize=1)
def _environment() -> Environment:
    """Load the templates, with escaping always on and no silent gaps."""
    loader = PackageLoader("tbm_gsa.app", "report")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
