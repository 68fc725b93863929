"""Whatever is done to a recording, reading it gives a result or one `RecordingError`: no crash, no hang, no warning."""

import faulthandler
import shutil
import warnings

import pytest
from bag_files import KINDS, Mutations, rewrite
from sample_bag import fill

from tbm_msgs_py import Bag, BagWriter, RecordingError, open_recording, read_recording
from tbm_msgs_py.bags.recovery import recover

INPUTS = 10_000
ALWAYS = 400  # of them; all under `verify`
RECOVERED = 8  # every so many inputs are recovered, too
HANG_S = 300  # the process ends with a traceback when one input takes longer


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    """Small recordings of every kind, a folder among them: metadata and file."""
    path = tmp_path_factory.mktemp("seeds")
    with BagWriter(path / "folder") as writer:
        fill(writer, range(4))
    bare = []
    for i, (compression, chunks) in enumerate(KINDS):
        file = rewrite(path / "folder", path / f"{i}.mcap", compression, chunk_size=3000, use_chunking=chunks)
        bare.append(file.read_bytes())
    return {file.name: file.read_bytes() for file in (path / "folder").iterdir()}, bare


def read_all(path, out):
    """Everything that reads: the index, messages, pieces, the whole, a recovery."""
    messages = 0
    for work in (
        lambda: Bag(path).info(),
        lambda: sum(1 for _ in Bag(path).messages()),
        lambda: list(open_recording(path).pieces(0.05)),
        lambda: read_recording(path),
        *([lambda: recover(path, out)] if out else []),
    ):
        try:
            result = work()
        except RecordingError as error:
            assert "\n" not in str(error)
        else:
            messages += bool(result)
    if out:
        shutil.rmtree(out, ignore_errors=True)
    return messages


def fuzz(seeds, path, numbers):
    folder, bare = seeds
    readable = 0
    for number in numbers:
        mutations = Mutations(number)
        faulthandler.dump_traceback_later(HANG_S, exit=True)
        if number % 5 == 4:
            where = path / "folder"
            where.mkdir(exist_ok=True)
            for i, (name, data) in enumerate(sorted(folder.items())):
                (where / name).write_bytes(mutations.damaged(data) if number % 3 != i else data)
        else:
            where = path / "bare.mcap"
            where.write_bytes(mutations.damaged(bare[number % 5]))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                readable += bool(read_all(where, path / "out" if number % RECOVERED == 0 else None))
            except BaseException as error:
                error.add_note(f"input {number}")
                raise
    faulthandler.cancel_dump_traceback_later()
    assert readable > 0.5 * len(numbers)  # or the damage would test nothing but the refusal


def test_damaged_recordings_are_read_or_refused(seeds, tmp_path):
    fuzz(seeds, tmp_path, range(ALWAYS))


@pytest.mark.verify
def test_ten_thousand_damaged_recordings_are_read_or_refused(seeds, tmp_path):
    fuzz(seeds, tmp_path, range(ALWAYS, INPUTS))
