"""Rendering of HTML pages that need nothing but themselves: no script, no remote content."""

import base64
from collections.abc import Mapping
from functools import lru_cache

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from tbm_gsa.app.report.picture import drawn


def render_page(template: str, context: Mapping[str, object]) -> str:
    """Render a template of this folder; everything in the context is escaped."""
    return _environment().get_template(template).render(context)


def embed_figure(figure: Figure, description: str) -> Markup:
    """Make an ``<img>`` with the figure inside as SVG.

    As an image and not as inline elements: the identifiers of several figures on one page would clash.

    Parameters
    ----------
    figure : Figure
    description : str
        What the figure shows, for those who cannot see it.
    """
    data = base64.b64encode(drawn(figure, ".svg")).decode("ascii")
    return Markup('<img src="data:image/svg+xml;base64,{}" alt="{}">').format(data, description)


@lru_cache(maxsize=1)
def _environment() -> Environment:
    """Load the templates, with escaping always on and no silent gaps."""
    loader = PackageLoader("tbm_gsa.app", "report")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
