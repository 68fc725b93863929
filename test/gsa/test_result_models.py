"""What commands print and store: a result is built with its own keys only; one of another version is read back.

Source: pydantic's own machinery; every result class there is, found by its base, made with a key that it lacks.
"""

import inspect
import json
from importlib import import_module
from pathlib import Path

import pytest
from pydantic import TypeAdapter, ValidationError, create_model

import tbm_gsa
from tbm_gsa.explanation.result import Misfits
from tbm_gsa.reading import Part, read_document
from tbm_msgs_py.base.fields import FrozenModel


def subclasses(base):
    for one in base.__subclasses__():
        yield from (one, *subclasses(one))


@pytest.fixture(scope="module")
def results():
    """Every result class; the modules that define them are those that name their base."""
    root = Path(tbm_gsa.__file__).parent
    for file in root.rglob("*.py"):
        if " Part" in file.read_text(encoding="utf-8"):
            import_module(".".join((tbm_gsa.__name__, *file.relative_to(root).with_suffix("").parts)))
    found = [*subclasses(Part), *subclasses(FrozenModel)]
    return [one for one in found if one.__module__.startswith("tbm_") and not inspect.isabstract(one)]


def test_a_result_with_an_unknown_key_is_refused(results):
    assert len(results) > 100
    for one in results:
        # Its own keys may be left out: what is refused is the other key, not that those are missing.
        optional = create_model(one.__name__, __base__=one, **dict.fromkeys(one.model_fields, (object, None)))
        with pytest.raises(ValidationError, match=r"no_such_key\W.*(no keys of|not permitted)"):
            optional(no_such_key=1)


def test_keys_of_another_version_are_left_out(tmp_path):
    misfits = {"model": 0.3, "predicted": 0.1, "checked": None, "of_another_version": 1}
    (tmp_path / "one.json").write_text(json.dumps({"one": misfits, "of_another_version": {"a": 1}}))
    form = create_model("Form", __base__=Part, one=(Misfits, ...))
    found = read_document(tmp_path / "one.json", form, "a document")
    assert found.one.predicted == 0.1
    assert "of_another_version" not in TypeAdapter(form).dump_json(found).decode()
