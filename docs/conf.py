"""Sphinx: the pages of this folder, and the reference that is made from the code."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "extensions")]

import tbm_gsa  # noqa: E402 - found by the line above

project = "tbm_monitor"
author = "tbm_monitor developers"
project_copyright = author
release = tbm_gsa.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "generated_pages",
    "mathml",
]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
suppress_warnings = ["ref.python"]  # two packages have an OperatingPoint; a docstring means that of its own
html_math_renderer = "mathml"

autodoc_typehints = "none"  # the docstrings say types, with their shapes
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False

exclude_patterns = ["_build"]
html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["formulas.css"]
html_title = f"tbm_monitor {release}"
html_show_sourcelink = False
html_copy_source = False
