"""Recordings reordered, torn, altered and damaged in every way: right frames or a loss that is told."""

import json

import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_frames import assert_same_frame, make_frame
from made_recordings import write
from mcap.writer import CompressionType, Writer
from other_writers import Parts, assemble, chunk_bytes, encoded, rewrite

from drivers import RecordingError, sr4000_calibration
from drivers.calibration import Calibration
from drivers.messages import FrameFields
from drivers.recording import Recording, attachments, open_recording, recover

SHAPE = (6, 8)
MAGIC = b"\x89MCAP0\r\n"

quick = settings(
    derandomize=True,
    deadline=None,
    max_examples=40,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@pytest.fixture(scope="module")
def frames():
    return [make_frame(k, burst=k // 4, pose=k % 4, shape=SHAPE) for k in range(12)]


@pytest.fixture(scope="module")
def source(frames, tmp_path_factory):
    known = sr4000_calibration().model_copy(update={"height": SHAPE[0], "width": SHAPE[1]})
    return write(tmp_path_factory.mktemp("source") / "source.mcap", frames, known)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("folder")


@st.composite
def writers(draw):
    """Options of another writer."""
    return {
        "compression": draw(st.sampled_from(CompressionType)),
        "chunk_size": draw(st.sampled_from([1, 600, 3_000, 1 << 20])),
        "use_chunking": draw(st.booleans()),
        "enable_crcs": draw(st.booleans()),
    }


def check(path, frames, folder, *, may_change=False):
    """What can be read is right, what is not is told, and what is saved is whole."""
    recording = Recording(path)
    by_sequence = {frame.sequence: frame for frame in frames}
    got = list(recording.frames())
    if not may_change:
        for back in got:
            assert_same_frame(back, by_sequence[back.sequence])
        assert len(got) == len(frames) or recording.damage is not None
        incomplete = set() if recording.damage is None else set(recording.damage.incomplete_frames)
        assert incomplete.isdisjoint(frame.sequence for frame in got)
    summary = recording.summary()
    summary.model_dump_json()
    assert "\n" not in (summary.problem or "") + (summary.damage_text or "")
    try:
        recover(recording, folder / "recovered.mcap")
    except RecordingError:
        assert not got
        return recording
    again = Recording(folder / "recovered.mcap")
    for back, frame in zip(again.frames(), got, strict=True):
        assert_same_frame(back, frame)
    if not may_change:
        assert again.damage is None
    return recording


@quick
@given(data=st.data(), options=writers())
def test_any_order_gives_the_frames(source, frames, folder, data, options):
    def arrange(found):
        return data.draw(st.permutations(found))

    path = rewrite(source, folder / "x.mcap", arrange, **options)
    recording = check(path, frames, folder)
    assert recording.damage is None
    assert [frame.sequence for frame in recording.frames()] == [frame.sequence for frame in frames]
    assert [len(burst) for burst in recording.bursts(99)] == [4, 4, 4]


@quick
@given(share=st.floats(0, 1, exclude_max=True), options=writers(), by_topic=st.booleans())
def test_a_torn_file_gives_what_it_holds(source, frames, folder, share, options, by_topic):
    def arrange(found):
        return sorted(found, key=lambda item: item[1].topic) if by_topic else found

    path = rewrite(source, folder / "x.mcap", arrange, **options)
    path.write_bytes(path.read_bytes()[: max(len(MAGIC), int(share * path.stat().st_size))])
    recording = check(path, frames, folder)
    assert recording.damage is not None


@quick
@given(
    flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 7)), min_size=1, max_size=4),
    chunk_size=st.sampled_from([1, 600, 3_000, 1 << 20]),
    compression=st.sampled_from(CompressionType),
)
def test_flipped_bits_are_noticed(source, frames, folder, flips, chunk_size, compression):
    path = rewrite(
        source,
        folder / "x.mcap",
        chunk_size=chunk_size,
        compression=compression,
        enable_data_crcs=True,
    )
    content = bytearray(path.read_bytes())
    for share, bit in flips:
        content[len(MAGIC) + int(share * (len(content) - len(MAGIC)))] ^= 1 << bit
    changed = content != path.read_bytes()
    path.write_bytes(content)
    recording = check(path, frames, folder)
    assert recording.damage is not None or not changed


@quick
@given(
    flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 7)), min_size=1, max_size=6),
    chunked=st.booleans(),
)
def test_flipped_bits_without_checksums_never_end_in_an_internal_error(
    source, frames, folder, flips, chunked
):
    path = rewrite(
        source,
        folder / "x.mcap",
        compression=CompressionType.NONE,
        use_chunking=chunked,
        chunk_size=2_000,
        enable_crcs=False,
    )
    content = bytearray(path.read_bytes())
    for share, bit in flips:
        content[len(MAGIC) + int(share * (len(content) - len(MAGIC)))] ^= 1 << bit
    path.write_bytes(content)
    check(path, frames, folder, may_change=True)


records = st.builds(
    lambda opcode, length, content: (
        bytes([opcode]) + (len(content) if length is None else length).to_bytes(8, "little") + content
    ),
    st.one_of(st.integers(0, 16), st.integers(0, 255)),
    st.one_of(st.none(), st.integers(0, 80), st.sampled_from([1 << 40, 1 << 60, (1 << 64) - 1])),
    st.binary(max_size=60),
)


@quick
@given(garbage=st.lists(records, max_size=8), ending=st.binary(max_size=40), inside=st.booleans())
def test_garbage_is_no_internal_error(frames, folder, garbage, ending, inside):
    data = b"".join(garbage)
    if inside:
        path = assemble(folder / "x.mcap", chunk_bytes([data], checksum=False))
    else:
        path = folder / "x.mcap"
        path.write_bytes(MAGIC + data + ending)
    check(path, frames, folder, may_change=True)
    with pytest.raises(RecordingError):
        open_recording(path)


texts = st.one_of(
    st.binary(max_size=60),
    st.text(max_size=60).map(str.encode),
    st.sampled_from([b"", b"\xff\xfe", b"width = 1e999", b"[intrinsics]\nfx = nan", b"PK\3\4" + b"\0" * 60]),
)


@quick
@given(
    name=st.sampled_from([attachments.CALIBRATION, attachments.TRUTH, attachments.CONFIGURATION, "other"]),
    content=texts,
    metadata=st.dictionaries(
        st.sampled_from([attachments.FRAMES_PER_BURST, "camera_model", "rig"]), st.text(max_size=20)
    ),
)
def test_damaged_attachments_and_metadata(source, frames, folder, name, content, metadata):
    def extra(writer):
        writer.add_attachment(1, 1 << 62, name, "", content)
        writer.add_metadata(attachments.METADATA, metadata)

    recording = check(rewrite(source, folder / "x.mcap", extra=extra), frames, folder)
    assert recording.damage is None
    assert recording.frame_count == len(frames)
    for read in (lambda: recording.calibration, lambda: recording.truth, lambda: recording.configuration):
        try:
            read()
        except RecordingError as error:
            assert "\n" not in str(error)  # noqa: PT017


@quick
@given(
    topic=st.sampled_from(["camera/frame", "camera/distance", "camera/amplitude", "camera/calibration"]),
    payload=texts,
    which=st.integers(0, 11),
)
def test_damaged_messages_cost_their_frame_alone(source, frames, folder, topic, payload, which):
    def arrange(found):
        messages = [message for _, channel, message in found if channel.topic == "/" + topic]
        messages[which % len(messages)].data = payload
        return found

    recording = check(rewrite(source, folder / "x.mcap", arrange), frames, folder)
    if topic == "camera/calibration":
        assert recording.damage is None
        return
    assert recording.frame_count == len(frames) - 1
    (unusable,) = recording.damage.unusable_frames
    assert unusable.sequence == frames[which].sequence
    assert open_recording(recording.path).frame_count == len(frames) - 1


numbers = st.one_of(
    st.sampled_from([0, -1, 1 << 63, -(1 << 63) - 1, 1 << 70, 1e308, -1e-308]),
    st.integers(),
    st.floats(),
    st.none(),
    st.text(max_size=5),
)
fields = st.dictionaries(st.sampled_from(sorted(FrameFields.model_fields)), numbers, max_size=3)


@quick
@given(changes=fields)
def test_fields_out_of_bounds_cost_their_frame_alone(source, frames, folder, changes):
    def arrange(found):
        first = next(message for _, channel, message in found if channel.topic == "/camera/frame")
        first.data = json.dumps(json.loads(first.data) | changes).encode()
        return found

    recording = check(rewrite(source, folder / "x.mcap", arrange), frames, folder, may_change=True)
    assert recording.frame_count >= len(frames) - 1
    for frame in recording.frames():
        assert min(frame.timestamp, frame.sequence) >= -(1 << 63)
        assert max(frame.timestamp, frame.sequence, frame.burst or 0, frame.pose or 0) < 1 << 63
        assert frame.integration_time is None or frame.integration_time > 0


@quick
@given(
    model=st.text(max_size=10),
    k=st.lists(st.floats(), max_size=12),
    d=st.lists(st.floats(), max_size=16),
    size=st.tuples(st.integers(0, 1 << 32 - 1), st.integers(0, 10_000)),
)
def test_any_calibration_message_is_a_calibration_or_refused(source, folder, model, k, d, size):
    said = CameraCalibration(distortion_model=model, K=k, D=d, width=size[0], height=size[1])
    parts = Parts.of(source)
    topics = {channel.id: channel.topic for channel in parts.channels}
    for message in parts.messages:
        if topics[message.channel_id] == "/camera/calibration":
            message.data = said.SerializeToString()
    inside = [encoded(record) for record in (*parts.definitions, *parts.messages)]
    recording = Recording(assemble(folder / "x.mcap", chunk_bytes(inside)))
    recording.problem()
    try:
        assert isinstance(recording.calibration, Calibration)
    except RecordingError as error:
        assert "\n" not in str(error)  # noqa: PT017


@quick
@given(
    definitions=st.lists(
        st.tuples(st.integers(0, 5), st.text(max_size=8), st.binary(max_size=20)), max_size=6
    )
)
def test_damaged_schemas_and_channels(frames, folder, definitions):
    path = folder / "x.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for schema, text, data in definitions:
            if schema < 3:
                writer.register_schema(text, text, data)
            topic = ["/camera/frame", "/camera/distance", "/camera/calibration", "/fused/depth", text, ""][
                schema
            ]
            encoding = ["json", "protobuf", text][len(data) % 3]
            channel = writer.register_channel(topic, encoding, schema, {text: text})
            writer.add_message(channel, 1, data, 1)
        writer.finish()
    check(path, frames, folder, may_change=True)
