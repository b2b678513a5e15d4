"""Several scans in one file: bursts of their own, each with its own calibration."""

from dataclasses import replace

import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from made_frames import make_frame
from made_recordings import write
from mcap.reader import make_reader
from mcap.writer import Writer

from drivers import RecordingError, make_camera, sr4000_calibration
from drivers.calibration import Mount
from drivers.messages import calibration_message
from drivers.recording import Recording, RecordingWriter, open_recording

HOUR = 3600 * 10**9
SHAPE = (12, 16)


def calibration(focal=100.0, shape=SHAPE, **changes):
    known = sr4000_calibration().model_copy(update={"height": shape[0], "width": shape[1], **changes})
    return known.model_copy(update={"intrinsics": known.intrinsics.model_copy(update={"fx": focal})})


def scan(path, later=0, shape=SHAPE, known=None, seed=0, count=6, first=0):
    frames = [
        make_frame(k, burst=k // 3, pose=k % 3, shape=shape, seed=seed, sequence=first + k)
        for k in range(count)
    ]
    moved = [replace(frame, timestamp=frame.timestamp + later) for frame in frames]
    return write(path, moved, known or calibration(shape=shape))


def merge(out, *paths, by_time=True, attachments=True):
    """As `mcap merge` does it: messages by log time, channels of one topic become one."""
    found = []
    with out.open("wb") as file:
        writer, ids = Writer(file), {}
        writer.start()
        for path in paths:
            with path.open("rb") as read:
                reader = make_reader(read)
                found += list(reader.iter_messages(log_time_order=False))
                for attached in reader.iter_attachments() if attachments else ():
                    writer.add_attachment(
                        attached.create_time,
                        attached.log_time,
                        attached.name,
                        attached.media_type,
                        attached.data,
                    )
                for metadata in reader.iter_metadata():
                    writer.add_metadata(metadata.name, metadata.metadata)
        for schema, channel, message in sorted(found, key=lambda item: by_time and item[2].log_time):
            if channel.topic not in ids:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, schema_id
                )
            writer.add_message(
                ids[channel.topic], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()
    return out


def bursts(recording):
    return [
        (burst[0].burst, len(burst), recording.calibration_of(burst[0]).intrinsics.fx)
        for burst in recording.bursts(15)
    ]


@pytest.mark.parametrize("attachments", [True, False])
def test_scans_an_hour_apart_keep_their_calibrations(tmp_path, attachments):
    one = scan(tmp_path / "a.mcap", known=calibration(100.0))
    other = scan(tmp_path / "b.mcap", HOUR, known=calibration(200.0, mount=Mount(lever_arm=(0.1, 0, 0))))
    for paths in ((one, other), (other, one)):
        recording = open_recording(merge(tmp_path / "x.mcap", *paths, attachments=attachments))
        assert bursts(recording) == [(0, 3, 100.0), (1, 3, 100.0), (0, 3, 200.0), (1, 3, 200.0)]
        arms = [recording.calibration_of(frame).mount.lever_arm[0] for frame in recording.frames()]
        assert arms == ([0.0] * 6 + [0.1] * 6 if attachments else [0.0] * 12)


def test_another_mount_alone_is_another_calibration(tmp_path):
    one = scan(tmp_path / "a.mcap")
    other = scan(tmp_path / "b.mcap", HOUR, known=calibration(mount=Mount(lever_arm=(0.1, 0, 0))))
    recording = open_recording(merge(tmp_path / "x.mcap", other, one))
    arms = [recording.calibration_of(burst[0]).mount.lever_arm[0] for burst in recording.bursts(15)]
    assert arms == [0.0, 0.0, 0.1, 0.1]


def test_cameras_of_two_sizes(tmp_path):
    one, other = scan(tmp_path / "a.mcap"), scan(tmp_path / "b.mcap", HOUR, shape=(8, 10))
    recording = open_recording(merge(tmp_path / "x.mcap", one, other))
    assert [entry.shape for entry in recording.entries] == [SHAPE] * 6 + [(8, 10)] * 6
    assert [burst.shape for burst in recording.summary().frames.bursts] == [SHAPE, SHAPE, (8, 10), (8, 10)]


def test_the_second_scan_has_a_fullest_burst_of_its_own(tmp_path):
    one, other = scan(tmp_path / "a.mcap"), scan(tmp_path / "b.mcap", HOUR, count=2)
    path = merge(tmp_path / "x.mcap", one, other)
    path.write_bytes(path.read_bytes()[:-10])  # the index is damaged, so something is said at all
    assert Recording(path).damage.short_bursts == ()


def test_scans_of_one_time_one_after_the_other_stay_apart(tmp_path):
    one, other = scan(tmp_path / "a.mcap"), scan(tmp_path / "b.mcap", seed=1)
    recording = open_recording(merge(tmp_path / "x.mcap", one, other, by_time=False))
    assert [len(burst) for burst in recording.bursts(15)] == [3, 3, 3, 3]
    counts = [frame.counts for frame in recording.frames()]
    assert (counts[0] == make_frame(0, shape=SHAPE).counts).all()
    assert (counts[6] == make_frame(0, shape=SHAPE, seed=1).counts).all()


def test_scans_of_one_time_mixed_are_refused(tmp_path):
    one, other = scan(tmp_path / "a.mcap"), scan(tmp_path / "b.mcap", seed=1)
    path = merge(tmp_path / "x.mcap", one, other)
    with pytest.raises(
        RecordingError, match="two frames of number 0 at one time; recordings of the same time"
    ):
        open_recording(path)


def test_calibrations_of_one_time_that_nothing_tells_apart_are_refused(tmp_path):
    one = scan(tmp_path / "a.mcap")
    other = scan(tmp_path / "b.mcap", known=calibration(mount=Mount(lever_arm=(0.1, 0, 0))), first=50)
    recording = Recording(merge(tmp_path / "x.mcap", one, other, by_time=False))
    with pytest.raises(RecordingError, match="2 different calibrations of one time, and nothing says which"):
        _ = recording.calibration


def test_a_calibration_that_changes_while_recording_begins_a_burst(tmp_path):
    path = tmp_path / "x.mcap"
    with RecordingWriter(path) as writer:
        for number in range(6):
            frame = make_frame(number, burst=0, pose=number, shape=SHAPE)
            if number % 4 == 0:
                writer.write_calibration(calibration(100.0 + number), frame.timestamp)
            writer.write_frame(frame, Mount())
    assert bursts(open_recording(path)) == [(0, 4, 100.0), (0, 2, 104.0)]


def test_a_message_that_says_nothing_is_not_a_calibration(tmp_path):
    path = tmp_path / "x.mcap"
    zeros = calibration_message(calibration(), 0)
    said = CameraCalibration.FromString(zeros.payload)
    said.K[:] = [0.0] * 9
    with RecordingWriter(path) as writer:
        writer.write(replace(zeros, payload=said.SerializeToString()), 0)
        writer.write_frame(make_frame(0, shape=SHAPE), Mount())
    with pytest.raises(RecordingError, match="holds no calibration"):
        _ = open_recording(path).calibration


def test_replay_gives_each_frame_its_calibration(tmp_path):
    one = scan(tmp_path / "a.mcap", known=calibration(100.0))
    other = scan(tmp_path / "b.mcap", HOUR, known=calibration(200.0))
    path = merge(tmp_path / "x.mcap", one, other)
    with make_camera("replay", {"path": str(path), "loop": True}) as camera:
        camera.start()
        seen = []
        for _ in range(24):
            camera.grab()
            seen.append(camera.calibration.intrinsics.fx)
    assert seen == ([100.0] * 6 + [200.0] * 6) * 2
