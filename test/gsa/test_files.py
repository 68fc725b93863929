"""Files of results: a writer that fails half way leaves what was there, and JSON is JSON.

Source: a disk that is full after half of the bytes; Python's own JSON reader, which is told to take no NaN.
"""

import errno
import json
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from tbm_gsa.app.report.picture import write_picture
from tbm_gsa.sensitivity.surrogates.files import save_surrogate
from tbm_msgs_py.base.files import write_json, write_whole

BEFORE = b"\x89PNG\r\nbefore"  # an earlier picture
WRITERS = {
    "document": lambda path, _: write_json(path, {"a": 1}),
    "picture": lambda path, _: write_picture(lambda: Figure(figsize=(1.0, 1.0)), path),
    "surrogate": lambda path, model: save_surrogate(model, path),
    "page": lambda path, _: write_whole(path, b"page"),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_what_was_there(tmp_path, monkeypatch, fitted, name):
    model, path = fitted("krg", "ishigami", 30), tmp_path / "result.png"
    path.write_bytes(BEFORE)
    write = Path.write_bytes

    def half(self, content):
        write(self, content[: len(content) // 2])
        raise OSError(errno.ENOSPC, "No space left on device", str(self))

    monkeypatch.setattr(Path, "write_bytes", half)
    with pytest.raises(OSError, match="No space left") as caught:
        WRITERS[name](path, model)
    assert caught.value.filename == str(path)
    assert path.read_bytes() == BEFORE
    assert list(tmp_path.iterdir()) == [path]
    monkeypatch.undo()
    WRITERS[name](path, model)
    assert path.read_bytes() != BEFORE
    assert list(tmp_path.iterdir()) == [path]


def test_numbers_that_are_none_become_null(tmp_path):
    write_json(tmp_path / "result.json", {"a": float("nan"), "b": [1.5, (float("inf"), "ω")]})
    text = (tmp_path / "result.json").read_text("utf-8")
    assert json.loads(text, parse_constant=pytest.fail) == {"a": None, "b": [1.5, [None, "ω"]]}
