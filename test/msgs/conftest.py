"""A small recording that every test of this folder may read."""

import pytest
from sample_bag import BLOCKS, fill

from tbm_msgs_py import BagWriter


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """rosbag2 folder, chunks not compressed."""
    path = tmp_path_factory.mktemp("bags") / "field"
    with BagWriter(path) as writer:
        fill(writer)
    return path


@pytest.fixture(scope="session")
def bare(tmp_path_factory):
    """Bare MCAP with zstd chunks of a few blocks each."""
    path = tmp_path_factory.mktemp("bare") / "field.mcap"
    with BagWriter(path, "zstd") as writer:
        for k in range(BLOCKS):
            fill(writer, [k])
            writer.flush()
    return path
