"""What every page must be: whole by itself, valid, small, named, and within the window it is read in."""

import html
import json
import re
import shutil
import subprocess
import tempfile
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest

LARGEST = 800_000
WIDTHS = (390, 1280)
PAPER = 720  # of A4 between its margins, 186 mm, and the bar of a window
VOID = {"meta", "br", "hr", "img", "input", "link", "col", "wbr", "source", "area", "base", "embed", "track"}
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
)
# Frames of a text are of the same origin as the page around them, which may measure them.
MEASURE = """<script>addEventListener("load", () => document.title = JSON.stringify(
  [...document.querySelectorAll("iframe")].map(frame => frame.contentDocument.scrollingElement).map(
    page => [page.scrollWidth, page.clientWidth])));</script>"""


class Page(HTMLParser):
    """Tags, references and identifiers of a page; an element that is not closed where it should be is an error."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.references, self.ids, self.open = [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.references += [value for name, value in attrs if name in {"src", "href", "srcset", "data", "xlink:href"}]
        self.ids += [value for name, value in attrs if name == "id"]
        assert len({name for name, _ in attrs}) == len(attrs)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def check_page(text, *, largest=LARGEST, machines=1, drawn=None):
    """Hold a page against what every page must be, and return what it is made of.

    `machines` are those it names, `drawn` those whose files are at hand, all by default.
    """
    page = Page(text)
    assert len(text.encode()) < largest
    assert not {"script", "link", "iframe", "object", "embed", "img", "base"} & set(page.tags)
    own = {f"#{name}" for name in page.ids}
    assert [one for one in page.references if one not in own and not one.startswith("data:image/png;base64,")] == []
    assert set(re.findall(r"url\(([^)]*)\)", text)) <= own
    assert not re.search(r"https?://|@import", text)
    assert len(set(page.ids)) == len(page.ids)
    figures = [ElementTree.fromstring(svg) for svg in re.findall(r"<svg.*?</svg>", text, re.DOTALL)]
    names = [figure.findtext("title") for figure in figures]
    assert all(names)
    assert len(set(names)) == len(names)
    facts = re.findall(r"<dt>(\w+)</dt><dd>([^<]+)</dd>", text)
    assert [fact for fact, _ in facts] == ["Data", "Page", *["Machine"] * machines, "Units"]
    assert re.fullmatch(r"made \d{4}-\d\d-\d\d \d\d:\d\d:\d\d UTC", dict(facts)["Page"])
    assert "m/s²" in dict(facts)["Units"]
    assert sum("Side view and drives of machine" in name for name in names) == (machines if drawn is None else drawn)
    return page


def check_widths(*texts):
    """No page is wider than its window, that of a telephone or of a desk, nor than paper, in a browser."""
    if CHROMIUM is None:
        pytest.skip("needs Chromium, which is not installed")
    printed = [(text.replace("@media print", "@media all"), PAPER) for text in texts]
    shown = [*((text, width) for text in texts for width in WIDTHS), *printed]
    frames = [f'<iframe width="{width}" height="800" srcdoc="{html.escape(text)}"></iframe>' for text, width in shown]
    with tempfile.TemporaryDirectory() as folder:
        wall = Path(folder, "wall.html")
        wall.write_text(f'<!DOCTYPE html><meta charset="utf-8">{MEASURE}{"".join(frames)}', "utf-8")
        call = [CHROMIUM, *OPTIONS, f"--user-data-dir={folder}/profile", "--dump-dom", wall.as_uri()]
        shown = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    sizes = json.loads(re.search("<title>(.*?)</title>", shown)[1])
    assert len(sizes) == len(frames)
    wide = [(needed, there) for needed, there in sizes if needed > there]
    assert not wide, wide
