"""Files of others that a user, or anybody over ROS, names for one of ours: one line, and not a word of them."""

import pytest

from tbm_dynamics import MachineError, load_machine
from tbm_dynamics.streaming.schedule import read_schedule
from tbm_gsa.sensitivity.study.definition import read_definition
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_msgs_py import RecordingError, load_mapping
from tbm_msgs_py.importing.description import describe

READERS = {
    "machine": (load_machine, MachineError),
    "schedule": (read_schedule, MachineError),
    "mapping": (load_mapping, RecordingError),
    "import description": (describe, RecordingError),
    "study definition": (read_definition, StudyError),
}
SECRETS = {
    "passwords": "root:x:0:0:hunter2:/root:/bin/sh\ndaemon:x:1:1:hunter2:/usr/sbin:/bin/false\n",
    "a line": "hunter2",
    "keys": "hunter2: {a: hunter2}\nother: hunter2\n",
    "no yaml": "a: [hunter2\nb: }hunter2{\n\thunter2: 1",
    "bytes": b"\xff\xfehunter2\x00",
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("secret", SECRETS)
def test_nothing_of_a_foreign_file_is_quoted(tmp_path, reader, secret):
    read, error = READERS[reader]
    content = SECRETS[secret]
    file = tmp_path / "file"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(error) as caught:
        read(file)
    assert str(file) in str(caught.value)
    assert "hunter2" not in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("hostile", ["[" * 5000, "a: " + "9" * 5000, "a: 2026-99-99", "a: !!int ''", "a: !!bool x"])
def test_hostile_numbers_and_nesting_are_one_line(tmp_path, reader, hostile):
    read, error = READERS[reader]
    (tmp_path / "file").write_text(hostile)
    with pytest.raises(error) as caught:
        read(tmp_path / "file")
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("reader", READERS)
def test_a_device_is_no_file(reader):
    read, error = READERS[reader]
    with pytest.raises(error, match="/dev/zero"):
        read("/dev/zero")
