"""A figure of a page holds what matplotlib's own SVG does, in a part of its size and in the colours of the page."""

import base64
import io
import re
from importlib import resources
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.image import imread
from report_pages import Page

from tbm_gsa.app.report.picture import LINE_COLUMNS, drawn, thinned
from tbm_gsa.app.report.svg import PAGE_COLOURS, inline_svg

POINTS = np.random.default_rng(1).normal(size=(2, 800))


def busy_figure():
    """A line, a cloud of points, bars with whiskers, a picture, a text of others."""
    figure = Figure(figsize=(8.0, 6.0))
    (line, cloud), (bars, picture) = figure.subplots(2, 2)
    line.plot(POINTS[0], color="#0072B2")
    cloud.scatter(*POINTS, s=9, color="#D55E00", marker="D")
    bars.bar(range(8), np.arange(1.0, 9.0), color="#1f5f99")
    bars.errorbar(range(8), np.ones(8), np.full(8, 0.2), fmt="none", ecolor="#333333", capsize=2)
    bars.set_title("<b>& x")
    picture.imshow(np.arange(200.0).reshape(10, 20), interpolation="none", aspect="auto")
    return figure


def places(path):
    """Corners of a path of straight lines, and of its parts, (n, 2)."""
    found, place = [], np.zeros(2)
    for letter, numbers in re.findall(r"([Mlz])([^Mlz]*)", path):
        values = np.array(re.findall(r"-?\d*\.?\d+", numbers), dtype=float).reshape(-1, 2)
        for value in values:
            place = place + value if letter == "l" else value
            found.append(place)
    return np.array(found)


@pytest.fixture(scope="module")
def both():
    """What matplotlib writes, and what a page holds."""
    theirs = ElementTree.fromstring(drawn(busy_figure(), ".svg"))
    return theirs, inline_svg(busy_figure(), "All <kinds>")


def test_a_figure_of_a_page_is_small_valid_and_named(both):
    theirs, text = both
    page = Page(text)
    assert page.references == [one for one in page.references if one.startswith(("#", "data:image/png"))]
    assert len(text) < 0.25 * len(ElementTree.tostring(theirs))
    own = ElementTree.fromstring(text)
    assert own.findtext("title") == "All <kinds>"
    assert "<b>& x" in [one.text for one in own.iter("text")]
    assert inline_svg(busy_figure(), "All <kinds>") == text
    assert not set(page.ids) & set(Page(inline_svg(busy_figure(), "another")).ids)


def test_colours_are_those_of_the_page(both):
    text = both[1]
    assert {f"var(--{name})" for name in ("blue", "red")} <= set(re.findall(r"var\(--\w+\)", text))
    assert "stroke:currentColor" in text
    assert not re.search("#(0072b2|d55e00|1f5f99|000000|333333|ffffff)", text)


def test_the_page_names_every_colour_light_and_dark():
    style = resources.files("tbm_gsa.app.report").joinpath("base.html").read_text("utf-8")
    light, dark = (set(re.findall(r"--([\w-]+): #", part)) for part in re.split(r"prefers-color-scheme: dark", style))
    named = {name[6:-1] for name in PAGE_COLOURS.values() if name.startswith("var(")}
    assert named < light == dark


def test_no_point_and_no_pixel_is_lost(both):
    theirs, text = both
    own = ElementTree.fromstring(text)
    uses = [one for one in theirs.iter() if one.tag.endswith("}use") and "x" in one.attrib]
    clouds = [places(one.attrib["d"]) for one in own.iter("path") if "marker" in one.attrib["style"]]
    cloud = next(one for one in clouds if len(one) == 800)
    expected = np.array([[float(one.attrib[key]) for key in "xy"] for one in uses])
    distance = np.abs(expected[:, None, :] - cloud[None, ::40, :]).max(axis=2).min(axis=0)
    assert distance.max() < 0.006
    (image,) = own.iter("image")
    pixels = imread(io.BytesIO(base64.b64decode(image.attrib["href"].partition(",")[2])))
    (before,) = (one for one in theirs.iter() if one.tag.endswith("}image"))
    address = before.attrib["{http://www.w3.org/1999/xlink}href"].partition(",")[2]
    assert np.abs(pixels[..., :3] - imread(io.BytesIO(base64.b64decode(address)))[..., :3]).max() < 0.06


@settings(max_examples=20, deadline=None)
@given(st.lists(st.tuples(st.floats(0.0, 800.0), st.floats(0.0, 600.0)), min_size=2, max_size=60))
def test_differences_do_not_add_up_along_a_line(corners):
    figure = Figure(figsize=(8.0, 6.0))
    panel = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, 800.0), ylim=(600.0, 0.0), frame_on=False)
    panel.set_axis_off()
    line = panel.plot(*zip(*corners, strict=True), color="#0072B2")[0]
    line.get_path().should_simplify = False
    own = ElementTree.fromstring(inline_svg(figure, "one"))
    found = [places(one.attrib["d"]) for one in own.iter("path") if "var(--blue)" in one.attrib["style"]]
    expected = np.array(corners) * (576.0 / 800.0, 432.0 / 600.0)
    np.testing.assert_allclose(found[0], expected, atol=0.06 if len(corners) > 50 else 0.006)


def test_a_long_line_keeps_its_extremes():
    rng = np.random.default_rng(2)
    time, values = np.arange(50_000.0), rng.normal(size=50_000)
    place, kept = thinned(time, values)
    assert len(kept) == 2 * LINE_COLUMNS
    assert (kept.min(), kept.max()) == (values.min(), values.max())
    assert np.all(np.diff(place) > 0.0)
    np.testing.assert_array_equal(values[place.astype(int)], kept)
    assert thinned(time[:500], values[:500])[0] is not None
