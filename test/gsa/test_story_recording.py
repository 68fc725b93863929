"""The recording of another rock and then a changed machine: its parts, how they are joined, and when they change."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from tbm_dynamics import load_machine
from tbm_msgs_py import read_recording
from tbm_msgs_py.bags.metadata import is_synthetic

BAGS = Path(__file__).parents[2] / "bags"


@pytest.fixture
def story(monkeypatch):
    monkeypatch.syspath_prepend(BAGS)
    return import_module("make_story_dz101")


def test_independent_parts_join_at_the_same_level(story):
    rng = np.random.default_rng(1)
    parts = [rng.standard_normal((60_000, 3)) for _ in range(2)]
    found = story._joined(parts)
    blend = round(story.BLEND_S * story.MODEL_RATE_HZ)
    assert len(found) == sum(map(len, parts)) - 2 * blend
    begin = len(parts[0]) - blend
    assert found[begin : begin + blend].std() == pytest.approx(1.0, abs=0.02)
    np.testing.assert_array_equal(found[:begin], parts[0][:-blend])


def test_its_parts_are_another_rock_and_then_a_changed_machine(story, tmp_path):
    first, second = story.PARTS
    assert {name.split(".")[0] for name in first} == {"loads"}
    assert second.keys() - first.keys() == {"x25"}
    assert first.items() <= second.items()
    machine = load_machine("dz101")
    values = story.accelerations(machine, 0.6)
    story.write_recording(tmp_path / "bag", machine, values, story.SEED)
    recording = read_recording(tmp_path / "bag")
    assert set(recording.points) == set(machine.description.test_points)
    assert max(record.duration for record in recording.points.values()) == pytest.approx(1.2, abs=0.01)
    assert is_synthetic(tmp_path / "bag")
