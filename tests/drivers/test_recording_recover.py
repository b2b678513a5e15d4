"""`recover` keeps every record as it is: foreign topics, schemas, profile, metadata, attachments."""

import tracemalloc
from pathlib import Path

import pytest
from made_frames import make_frame
from made_recordings import flipped, write
from mcap.reader import make_reader
from mcap.writer import CompressionType
from other_writers import Parts, assemble, by_topic, chunk_bytes, encoded, padded, rewrite

from drivers import sr4000_calibration
from drivers.recording import Recording, open_recording, recover

ROSBAGS = Path(__file__).parents[3] / "shared" / "data" / "rosbag2"


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    frames = [make_frame(k, burst=k // 15, pose=k % 15, shape=(144, 176)) for k in range(30)]
    return write(tmp_path_factory.mktemp("source") / "source.mcap", frames, sr4000_calibration())


def everything(path):
    """All that other programs see of a file; that it can be read at all, checksums compared."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        messages = [
            (schema and (schema.name, schema.encoding, schema.data), channel, message)
            for schema, channel, message in reader.iter_messages(log_time_order=False)
        ]
        return {
            "profile": reader.get_header().profile,
            "messages": messages,
            "schemas": reader.get_summary().schemas,
            "channels": reader.get_summary().channels,
            "metadata": list(reader.iter_metadata()),
            "attachments": list(reader.iter_attachments()),
            "counts": dict(reader.get_summary().statistics.channel_message_counts),
        }


def recovered(path, tmp_path):
    output = tmp_path / "recovered.mcap"
    saved = recover(Recording(path), output)
    assert Recording(output).damage is None
    found = everything(output)
    assert saved == len(found["messages"])
    return found


def foreign(writer):
    """Topics of a robot: cdr, two schemas on one topic, none at all, no slash, a channel with metadata."""
    tf = writer.register_schema("tf2_msgs/msg/TFMessage", "ros2msg", b"geometry_msgs/TransformStamped[]")
    writer.add_message(writer.register_channel("/tf", "cdr", tf, {"qos": "- a\n"}), 1, b"\0\1", 1, 9)
    for name in ("std_msgs/msg/String", "std_msgs/msg/Int8"):
        schema = writer.register_schema(name, "ros2msg", name.encode())
        writer.add_message(writer.register_channel("topic1", "cdr", schema), 2, name.encode(), 2)
    writer.add_message(writer.register_channel("bare", "", 0), 3, b"", 3)
    writer.add_metadata("lidarboost", {"rig": "another"})
    writer.add_metadata("robot", {"name": "é"})
    writer.add_attachment(5, 6, "map.bin", "application/x", bytes(range(256)) * 9_000)
    writer.add_attachment(5, 7, "map.bin", "application/x", b"")


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("options", [{}, {"use_chunking": False}, {"chunk_size": 1}], ids=str)
def test_everything_of_other_writers_stays(source, tmp_path, compression, options):
    path = rewrite(source, tmp_path / "x.mcap", by_topic, foreign, "ros2", compression=compression, **options)
    assert recovered(path, tmp_path) == everything(path)
    summary = Recording(path).summary()
    assert {topic.topic: topic.schema_name for topic in summary.topics}["topic1"] == (
        "std_msgs/msg/String, std_msgs/msg/Int8"
    )
    assert open_recording(tmp_path / "recovered.mcap").frame_count == 30


@pytest.mark.parametrize("name", ["talker.mcap", "test_bag_for_seek_0.mcap"])
def test_real_ros_2_files_stay_as_they_are(tmp_path, name):
    if not ROSBAGS.exists():
        pytest.skip("no ROS 2 files here")
    assert recovered(ROSBAGS / name, tmp_path) == everything(ROSBAGS / name)


def test_a_torn_file_keeps_what_is_foreign(source, tmp_path):
    path = rewrite(source, tmp_path / "x.mcap", lambda found: found, profile="ros2", chunk_size=100_000)
    whole = everything(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    found = recovered(path, tmp_path)
    assert found["messages"] == whole["messages"][: len(found["messages"])]
    assert len(found["messages"]) > 40
    assert (found["profile"], found["metadata"]) == ("ros2", whole["metadata"])


def test_chunks_that_are_whole_are_copied_byte_for_byte(source, tmp_path):
    whole = tmp_path / "whole.mcap"
    recover(Recording(source), whole)
    content, copied = source.read_bytes(), whole.read_bytes()
    with source.open("rb") as file:
        indexes = make_reader(file).get_summary().chunk_indexes
    assert len(indexes) > 5
    for index in indexes:
        assert content[index.chunk_start_offset :][: index.chunk_length] in copied


def test_messages_of_frames_that_are_not_whole_are_left_out(source, tmp_path):
    with source.open("rb") as file:
        index = make_reader(file).get_summary().chunk_indexes[2]
    damaged = Recording(flipped(source, tmp_path, index.chunk_start_offset + index.chunk_length // 2))
    assert damaged.damage.incomplete_frames
    found = recovered(damaged.path, tmp_path)
    counts = [sum(c.topic == f"/camera/{t}" for _, c, _ in found["messages"]) for t in ("distance", "frame")]
    assert counts == [damaged.frame_count] * 2


def test_schemas_of_a_lost_chunk_come_from_the_index(source, tmp_path):
    with source.open("rb") as file:
        index = make_reader(file).get_summary().chunk_indexes[0]
    path = flipped(source, tmp_path, index.chunk_start_offset + index.chunk_length - 100)
    assert {schema[0] for schema, _, _ in recovered(path, tmp_path)["messages"]} >= {"foxglove.RawImage"}


def test_padded_and_unknown_records_are_kept(source, tmp_path):
    path = padded(source, tmp_path / "x.mcap")
    recover(Recording(path), tmp_path / "recovered.mcap")
    found = open_recording(tmp_path / "recovered.mcap")  # the library cannot read such schemas in chunks
    assert found.damage is None
    assert list(found.messages()) == list(open_recording(source).messages())
    assert {entry.name: found.load(entry) for entry in found.contents.attachments} == {
        attached.name: attached.data for attached in everything(source)["attachments"]
    }
    private = b"\x90" + (7).to_bytes(8, "little") + b"private"
    parts = Parts.of(source)
    inside = [encoded(record) for record in (*parts.definitions, *parts.messages)]
    recover(Recording(assemble(tmp_path / "y.mcap", private + chunk_bytes(inside))), tmp_path / "z.mcap")
    assert private in (tmp_path / "z.mcap").read_bytes()


def test_a_channel_whose_schema_is_lost_has_none(source, tmp_path):
    parts = Parts.of(source)
    inside = [encoded(record) for record in (*parts.schemas[1:], *parts.channels, *parts.messages)]
    found = recovered(assemble(tmp_path / "x.mcap", chunk_bytes(inside)), tmp_path)
    assert sum(schema is None for schema, _, _ in found["messages"]) > 0
    assert len(found["messages"]) == len(parts.messages)


def test_attachments_are_copied_in_blocks(source, tmp_path):
    path = rewrite(
        source, tmp_path / "x.mcap", extra=lambda w: w.add_attachment(0, 0, "huge", "x", bytes(50_000_000))
    )
    tracemalloc.start()
    recover(Recording(path), tmp_path / "y.mcap")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20_000_000
    assert Recording(tmp_path / "y.mcap").attachment("huge") == bytes(50_000_000)
