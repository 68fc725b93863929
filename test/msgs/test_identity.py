"""What a message is: by its definition in the file, its type, its frame and its marks, never by a name alone."""

from pathlib import Path

import numpy as np
import pytest
import sensor_msgs
from bag_files import write_accel
from mcap.writer import Writer as McapWriter
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore
from sample_bag import START_NS

from tbm_msgs_py import ACCELERATION, BagWriter, RecordingError, SensorMapping, TopicMapping, read_recording
from tbm_msgs_py.bags.batch import Topic
from tbm_msgs_py.bags.definitions import recorded_types, typestore
from tbm_msgs_py.recordings.marks import UNMEASURED_TEXT

IMU, VECTOR, ACCEL = "sensor_msgs/msg/Imu", "geometry_msgs/msg/Vector3Stamped", "geometry_msgs/msg/AccelStamped"
TOPIC = "/tbm/field/shield/accel"
MS = 10**6
PART = "\n" + "=" * 80 + "\nMSG: "
HEADER = (
    f"{PART}std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id"
    f"{PART}builtin_interfaces/Time\nint32 sec\nuint32 nanosec"
)
XYZ = f"{PART}geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z"
STANDARD = f"std_msgs/Header header\ngeometry_msgs/Vector3 vector{XYZ}{HEADER}\n"
PARTS = (
    "std_msgs/msg/Header",
    "builtin_interfaces/msg/Time",
    "geometry_msgs/msg/Quaternion",
    "geometry_msgs/msg/Vector3",
)


def stores(kind, text):
    """Types of a definition, by the library alone."""
    store = Typestore()
    store.register(get_types_from_msg(text, kind))
    return store


def standard(kind):
    return typestore().generate_msgdef(kind, ros_version=2)[0]


def message(store, kind, k, frame="a", xyz=None, covariance=0.0):
    """Serialised sample k of an acceleration type, whatever its definition adds to the standard."""
    types = store.types
    vector = types["geometry_msgs/msg/Vector3"](*map(float, xyz or (k, 2, 3)))
    stamp = types["builtin_interfaces/msg/Time"](*divmod(START_NS + k * MS, 10**9))
    parts = {"header": types["std_msgs/msg/Header"](stamp, frame), "vector": vector, "linear_acceleration": vector}
    if kind == ACCEL:
        parts["accel"] = types["geometry_msgs/msg/Accel"](vector, types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0))
    if kind == IMU:
        parts |= {
            "orientation": types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
            "angular_velocity": types["geometry_msgs/msg/Vector3"](7.0, 7.0, 7.0),
        }
    parts |= {name: np.full(9, covariance) for name in types[kind].__dataclass_fields__ if name.endswith("covariance")}
    parts["temperature"] = 20.0
    fields = [name for name in types[kind].__dataclass_fields__ if not name.startswith("__")]
    return bytes(store.serialize_cdr(types[kind](**{name: parts[name] for name in fields}), kind))


def write(path, *channels, topic=TOPIC):
    """Channels (type, schema encoding, definition, message encoding, messages (log ms, bytes)) of one topic."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2", "test")
        for kind, schema_encoding, text, encoding, messages in channels:
            schema = writer.register_schema(kind, schema_encoding, text.encode())
            channel = writer.register_channel(topic, encoding, schema)
            for k, data in messages:
                writer.add_message(channel, START_NS + k * MS, data, START_NS + k * MS)
        writer.finish()
    return path


def samples(store, kind, numbers, **options):
    return [(k, message(store, kind, k, **options)) for k in numbers]


def idl_of(kind, *parts):
    share = Path(sensor_msgs.__path__[0])
    folder = next(parent / "share" for parent in share.parents if (parent / "share" / f"{kind}.idl").is_file())
    return "".join("=" * 80 + f"\nIDL: {name}\n" + (folder / f"{name}.idl").read_text() for name in (kind, *parts))


@pytest.mark.parametrize("text", [standard(VECTOR), STANDARD, "# another comment\n" + STANDARD])
def test_the_standard_definition_is_known_in_any_layout(text):
    assert recorded_types(Topic("/a", VECTOR, definition=text, schema_encoding="ros2msg")) is typestore()


def test_the_idl_files_of_ros_are_the_standard():
    text = idl_of(IMU, *PARTS)
    assert recorded_types(Topic("/a", IMU, definition=text, schema_encoding="ros2idl")) is typestore()


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (VECTOR, STANDARD.replace("geometry_msgs/Vector3 vector", "float64 temperature\ngeometry_msgs/Vector3 vector")),
        (VECTOR, "geometry_msgs/Vector3 vector\nstd_msgs/Header header" + XYZ + HEADER),
        (VECTOR, STANDARD.replace("float64", "float32")),
        (IMU, standard(IMU).replace("geometry_msgs/Quaternion orientation\n", "")),
    ],
)
def test_another_definition_is_decoded_as_it_says(tmp_path, kind, text):
    store = stores(kind, text)
    assert recorded_types(Topic("/a", kind, definition=text)) is not typestore()
    path = write(tmp_path / "a.mcap", (kind, "ros2msg", text, "cdr", samples(store, kind, range(50))))
    record = read_recording(path).points["shield"]
    np.testing.assert_array_equal(record.values, np.column_stack([np.arange(50), np.full(50, 2), np.full(50, 3)]))
    assert record.faults.undecodable == 0


GOOD = samples(typestore(), VECTOR, range(50))
SCALARS = STANDARD.replace("geometry_msgs/Vector3 vector", "float64 x")


@pytest.mark.parametrize(
    ("kind", "schema_encoding", "text", "encoding", "named"),
    [
        (VECTOR, "ros2msg", standard(VECTOR), "json", "message encoding 'json', allowed: cdr"),
        (VECTOR, "ros1msg", standard(VECTOR), "ros1", "message encoding 'ros1', allowed: cdr"),
        (VECTOR, "protobuf", standard(VECTOR), "cdr", "defined in protobuf, allowed: ros2msg, ros2idl"),
        (VECTOR, "ros2msg", "", "cdr", "its definition is missing"),
        (VECTOR, "ros2msg", "no definition at all {", "cdr", "its definition cannot be read"),
        (
            VECTOR,
            "ros2msg",
            "std_msgs/Header header\ngeometry_msgs/Vector3 vector\n",
            "cdr",
            "its definition cannot be read",
        ),
        (VECTOR, "ros2msg", SCALARS, "cdr", "as the recording defines it: "),
        ("std_msgs/msg/String", "ros2msg", "string data", "cdr", "type std_msgs/msg/String, allowed: "),
    ],
)
def test_what_cannot_be_decoded_is_refused_by_name(tmp_path, kind, schema_encoding, text, encoding, named):
    path = write(tmp_path / "a.mcap", (kind, schema_encoding, text, encoding, GOOD))
    with pytest.raises(RecordingError, match=f"topic {TOPIC}: .*{named}") as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)
    assert "allowed: " in str(caught.value)


def test_a_missing_definition_is_made_up_for_by_its_hash():
    known = typestore().hash_rihs01(VECTOR)
    assert recorded_types(Topic("/a", VECTOR, type_hash=known)) is typestore()
    with pytest.raises(RecordingError, match="missing"):
        recorded_types(Topic("/a", VECTOR, type_hash=known.replace("a", "b")))


def test_channels_that_differ_are_not_merged(tmp_path):
    """Half of a topic is of another type, or of one type with another definition: the larger part is used."""
    other = STANDARD.replace("geometry_msgs/Vector3 vector", "float64 temperature\ngeometry_msgs/Vector3 vector")
    for name, kind, text in (("type", ACCEL, standard(ACCEL)), ("text", VECTOR, other)):
        first = (VECTOR, "ros2msg", standard(VECTOR), "cdr", GOOD)
        second = (kind, "ros2msg", text, "cdr", samples(stores(kind, text), kind, range(50, 90)))
        recording = read_recording(write(tmp_path / f"{name}.mcap", first, second))
        assert len(recording.points["shield"].time) == 50
        (left_out,) = recording.left_out
        assert (left_out.topic, left_out.messages) == (TOPIC, 40)
        assert kind in left_out.what
        assert f"{VECTOR}, definition" in left_out.reason


def test_channels_that_agree_are_merged(tmp_path):
    comment = "# of another publisher\n" + STANDARD
    channels = [(VECTOR, "ros2msg", text, "cdr", GOOD[k::2]) for k, text in enumerate((standard(VECTOR), comment))]
    recording = read_recording(write(tmp_path / "a.mcap", *channels))
    assert (len(recording.points["shield"].time), recording.left_out) == (50, [])


@pytest.mark.parametrize("kind", [VECTOR, "other definition"])
def test_two_sensors_on_one_topic_are_not_mixed(tmp_path, kind):
    text = standard(VECTOR) if kind == VECTOR else "geometry_msgs/Vector3 vector\nstd_msgs/Header header" + XYZ + HEADER
    store = stores(VECTOR, text)
    mixed = [(k, message(store, VECTOR, k, frame="left" if k % 3 else "right")) for k in range(90)]
    path = write(tmp_path / "a.mcap", (VECTOR, "ros2msg", text, "cdr", mixed))
    recording = read_recording(path)
    assert len(recording.points["shield"].time) == 60
    assert [(one.what, one.messages) for one in recording.left_out] == [("frame_id 'right'", 30)]
    assert "frame_id 'left' is used" in str(recording.left_out[0])
    stated = {"point": "shield", "units": "m/s2", "gravity": "removed", "frame": "fixed"}
    chosen = TopicMapping(topics={TOPIC: SensorMapping(**stated, frame_id="right")})
    assert len(read_recording(path, chosen).points["shield"].time) == 30
    missing = TopicMapping(topics={TOPIC: SensorMapping(**stated, frame_id="middle")})
    with pytest.raises(RecordingError, match="no message of frame_id 'middle'"):
        read_recording(path, missing)


@pytest.mark.parametrize(
    "definition", [standard(IMU), standard(IMU).replace("geometry_msgs/Quaternion orientation\n", "")]
)
def test_samples_marked_as_not_measured_are_none(tmp_path, definition):
    store = stores(IMU, definition)
    rows = [(k, message(store, IMU, k, covariance=-1.0 if k % 2 else 0.0)) for k in range(60)]
    recording = read_recording(write(tmp_path / "a.mcap", (IMU, "ros2msg", definition, "cdr", rows)))
    assert (len(recording.points["shield"].time), recording.faults["shield"].unmeasured) == (30, 30)
    silent = write(tmp_path / "b.mcap", (IMU, "ros2msg", definition, "cdr", rows[1::2]))
    with pytest.raises(RecordingError, match=UNMEASURED_TEXT.split(",")[0].replace("[", r"\[").replace("]", r"\]")):
        read_recording(silent)


def test_an_imu_of_another_length_is_undecodable(tmp_path):
    """Cut within the covariance behind its numbers, or eight bytes longer than its definition says."""
    rows = samples(typestore(), IMU, range(10))
    cut = [(k, {4: data[:-16], 5: data + bytes(8)}.get(k, data)) for k, data in rows]
    recording = read_recording(write(tmp_path / "a.mcap", (IMU, "ros2msg", standard(IMU), "cdr", cut)))
    assert (len(recording.points["shield"].time), recording.faults["shield"].undecodable) == (8, 2)


def test_single_samples_beside_blocks_are_counted(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(20):
            write_accel(writer, "/tbm/field/shield/accel", START_NS + k * MS, (k, 0, 0))
        writer.write_block("/tbm/field/shield/block", START_NS, ACCELERATION, np.arange(20) / 1000, np.ones((20, 3)))
    (left_out,) = read_recording(tmp_path / "bag").left_out
    assert (left_out.topic, left_out.messages) == ("/tbm/field/shield/accel", 20)


def test_a_topic_that_is_not_there_is_named(tmp_path):
    path = write(tmp_path / "a.mcap", (VECTOR, "ros2msg", standard(VECTOR), "cdr", GOOD), topic="/imu")
    stated = {"units": "m/s2", "gravity": "removed", "frame": "fixed"}
    topics = {"/imu": SensorMapping(point="shield", **stated), "/imo": SensorMapping(point="girder", **stated)}
    recording = read_recording(path, TopicMapping(topics=topics, operating_point="/imu"))
    assert recording.problems["girder"].startswith("topic /imo is not in the recording, allowed: /imu")
    assert f"operating point: topic /imu: type {VECTOR}, allowed: sensor_msgs/msg/JointState" in recording.doubts[0]
    (missing,) = read_recording(path, TopicMapping(topics=topics, operating_point="/opp")).doubts
    assert "topic /opp is not in the recording" in missing
