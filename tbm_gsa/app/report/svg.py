"""A figure as inline SVG: small, in the letters and colours of its page, which is light or dark."""

from __future__ import annotations

import base64
import re
from functools import lru_cache
from io import BytesIO
from itertools import count, groupby
from typing import Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from matplotlib import rc_context
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from PIL import Image

# Colours that figures are drawn in, and what base.html calls them; any other is the same on both sides.
PAGE_COLOURS: Final = {
    "#000000": "currentColor",
    "#222222": "currentColor",
    "#333333": "currentColor",
    "#ffffff": "var(--ground)",
    "#555555": "var(--quiet)",
    "#7f7f7f": "var(--quiet)",
    "#888888": "var(--quiet)",
    "#b0b0b0": "var(--faint)",
    "#b5bcc5": "var(--faint)",
    "#d8dee6": "var(--line)",
    "#e3e7ec": "var(--line)",
    "#ffe680": "var(--mark)",
    "#0072b2": "var(--blue)",
    "#1f5f99": "var(--blue)",
    "#b9d3ea": "var(--light-blue)",
    "#56b4e9": "var(--sky)",
    "#d55e00": "var(--red)",
    "#d00000": "var(--red)",
    "#009e73": "var(--green)",
    "#cc79a7": "var(--pink)",
    "#e8c4d8": "var(--light-pink)",
    "#6a3d9a": "var(--violet)",
    "#8c510a": "var(--brown)",
    "#e69f00": "var(--orange)",
}
PALETTE_SIZE: Final = 64  # colours of a picture in a figure
LONG_PATH: Final = 50  # steps; a tenth of a point is fine enough from there on
LEAST_MARKERS: Final = 3  # alike in a row, which become one path
_NUMBER: Final = re.compile(r"-?\d+\.\d+(?:e[-+]?\d+)?")
_UPRIGHT: Final = re.compile(r"rotate\(-?0 [^)]*\)")
_STEP: Final = re.compile(r"([MLCQz])([^MLCQz]*)")
_COLOUR: Final = re.compile(r"#[0-9a-f]{6}\b")
_REFERRED: Final = re.compile(r"url\(#([^)]+)\)")
_SVG: Final = "{http://www.w3.org/2000/svg}"
_AT_ITS_SIZE: Final = {"markerUnits": "userSpaceOnUse", "overflow": "visible"}
_HREF: Final = "{http://www.w3.org/1999/xlink}href"


def inline_svg(figure: Figure, description: str) -> str:
    """Draw a figure as an ``<svg>`` for a page; equal figures give equal texts.

    Parameters
    ----------
    figure : Figure
    description : str
        What it shows, its name for those who cannot see it; another one for each figure of a page, as the identifiers
        within are made of it.
    """
    for ground in (figure.patch, *(panel.patch for panel in figure.axes)):
        ground.set_visible(False)  # that of the page is seen
    buffer = BytesIO()
    with rc_context({"svg.hashsalt": description, "svg.fonttype": "none"}):
        FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})  # type: ignore[no-untyped-call]
    root = ElementTree.fromstring(buffer.getvalue())  # noqa: S314 - written two lines above
    _tidy(root)
    _drop_names(root)
    _open_groups(root)
    _join_markers(root)
    _drop_shapes(root)
    _join_paths(root)
    shown = Element("svg", {"viewBox": root.attrib["viewBox"], "role": "img"})
    SubElement(shown, "title").text = description
    shown.extend(root)
    return ElementTree.tostring(shown, encoding="unicode")


def _tidy(element: Element) -> None:
    """Shorten numbers, styles and pictures below an element, and drop what a page does not need."""
    for child in list(element):
        child.tag = child.tag.removeprefix(_SVG)
        if child.tag in ("metadata", "style"):
            element.remove(child)
            continue
        child.tail = None
        if child.text and not child.text.strip():
            child.text = None
        if _HREF in child.attrib:
            child.set("href", child.attrib.pop(_HREF))
        if child.tag == "image":
            child.set("href", _fewer_colours(child.attrib["href"]))
        else:
            for name in child.attrib.keys() & {"x", "y", "width", "height", "transform"}:
                child.set(name, _NUMBER.sub(lambda number: _brief(float(number[0])), child.attrib[name]))
        if _UPRIGHT.fullmatch(child.attrib.get("transform", "")):
            child.attrib.pop("transform")
        if child.tag == "path":
            child.set("d", _short_path(child.attrib.get("d", "")))  # of nothing there is none
        if "style" in child.attrib:
            child.set("style", _short_style(child.attrib["style"]))
        _tidy(child)


@lru_cache(maxsize=4096)  # steps along a line are much alike
def _brief(value: float) -> str:
    """Two digits after the point, a fiftieth of a pixel, and none that says nothing."""
    text = f"{round(value, 2) + 0.0:.2f}".rstrip("0").rstrip(".")
    return text.replace("0.", ".") if text.startswith(("0.", "-0.")) else text


def _short_path(path: str) -> str:
    """Write steps of straight lines as differences, which are short, and no letter twice; curves stay as they are."""
    given = _STEP.findall(path)
    unit = 0.1 if len(given) > LONG_PATH else 0.01
    steps: list[tuple[str, list[int]]] = []
    place = [0, 0]
    for letter, numbers in given:
        ends = [round(float(number) / unit) for number in numbers.split()]
        straight = "l", [end - begin for begin, end in zip(place, ends, strict=False)]
        steps.append(straight if letter == "L" else (letter, ends))
        place = ends[-2:] or place
    written = []
    for letter, alike in groupby(steps, lambda step: step[0]):
        places = [" ".join(_brief(value * unit) for value in values) for _, values in alike]
        # A second M would be a line to there if its letter were left out.
        written.append("".join(letter + at for at in places) if letter == "M" else letter + " ".join(places))
    return "".join(written).replace(" -", "-")


def _short_style(style: str) -> str:
    """Drop names of fonts, which the page states, and name the colours as it does."""
    kept = (part.strip().replace(": ", ":") for part in style.split(";") if part and "font-family" not in part)
    return _COLOUR.sub(lambda colour: PAGE_COLOURS.get(colour[0], colour[0]), ";".join(kept))


def _fewer_colours(address: str) -> str:
    """Write a picture again with a palette, which takes a fifth of the space."""
    head, _, data = address.partition(",")
    buffer = BytesIO()
    picture = Image.open(BytesIO(base64.b64decode(data)))
    picture.quantize(PALETTE_SIZE, method=Image.Quantize.FASTOCTREE).save(buffer, format="png", optimize=True)
    return f"{head},{base64.b64encode(buffer.getvalue()).decode('ascii')}"


def _used_names(root: Element) -> set[str]:
    """Names of parts that another refers to."""
    used = {found for part in root.iter() for value in part.attrib.values() for found in _REFERRED.findall(value)}
    return used | {part.attrib["href"][1:] for part in root.iter("use")}


def _drop_names(root: Element) -> None:
    """Drop the names that nothing refers to: the same are in other figures of the page."""
    used = _used_names(root)
    for part in root.iter():
        if part.attrib.get("id") not in used:
            part.attrib.pop("id", None)


def _open_groups(element: Element) -> None:
    """Put what is in a group that says nothing in its place."""
    for child in element:
        _open_groups(child)
    element[:] = [inner for child in element for inner in (child if child.tag == "g" and not child.attrib else [child])]


def _join_markers(root: Element) -> None:
    """Make one path of markers that are alike, points of a cloud or ticks of an axis: a tenth is left of thousands."""
    shapes = {part.attrib["id"]: part for part in root.iter("path") if "id" in part.attrib}
    numbers = count()
    for parent in list(root.iter()):
        alike: dict[tuple[str, str], list[Element]] = {}
        for use in parent.findall("use"):
            alike.setdefault((use.attrib["href"][1:], use.attrib["style"]), []).append(use)
        for (name, style), uses in alike.items():
            if len(uses) >= LEAST_MARKERS:
                marker = Element("marker", {"id": f"{name}-{next(numbers)}", **_AT_ITS_SIZE})
                shape = shapes[name].attrib
                SubElement(marker, "path", {"d": shape["d"], "style": f"{style};{shape.get('style', '')}".strip(";")})
                _put_in_place(parent, uses, marker)


def _put_in_place(parent: Element, uses: list[Element], marker: Element) -> None:
    """Put a marker, and a path through the places of all its uses, in place of the first one."""
    places = " ".join(f"{use.attrib['x']} {use.attrib['y']}" for use in uses)
    path = Element("path", {"d": f"M{places}", "style": f"fill:none;marker:url(#{marker.attrib['id']})"})
    gone = set(map(id, uses))
    parent[:] = [
        inner
        for child in parent
        for inner in ((marker, path) if child is uses[0] else () if id(child) in gone else (child,))
    ]


def _drop_shapes(root: Element) -> None:
    """Drop shapes that nothing refers to."""
    used = _used_names(root)
    for parent in list(root.iter()):
        if parent.tag == "defs":
            parent[:] = [shape for shape in parent if shape.attrib["id"] in used]
    for parent in list(root.iter()):
        parent[:] = [child for child in parent if child.tag != "defs" or len(child)]


def _join_paths(element: Element) -> None:
    """Make one path of neighbours that differ in their course only, as bars and whiskers do."""
    joined: list[Element] = []
    for child in element:
        _join_paths(child)
        before = joined[-1] if joined else child
        if before is not child and _alike(before, child):
            before.set("d", before.attrib["d"] + child.attrib["d"])
        else:
            joined.append(child)
    element[:] = joined


def _alike(first: Element, second: Element) -> bool:
    """Whether two paths are drawn alike, and one over the other is seen as one."""
    if (first.tag, second.tag) != ("path", "path") or "opacity" in first.attrib.get("style", ""):
        return False
    return {**first.attrib, "d": ""} == {**second.attrib, "d": ""} and not {"id", "transform"} & first.attrib.keys()
