"""Reading a recording back: the very same frames, and what is missing where it is damaged."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from io import BytesIO
from itertools import groupby
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from mcap.records import Attachment
from numpy.typing import NDArray

from drivers.calibration import Calibration, Intrinsics
from drivers.errors import RecordingError
from drivers.frame import Frame
from drivers.messages import CAMERA_CALIBRATION, Message, decode_calibration
from drivers.recording import attachments
from drivers.recording.assembly import FRAME_TOPICS, FrameAssembler
from drivers.recording.contents import FrameEntry, TopicEntry, read_contents, read_messages
from drivers.recording.damage import Damage, ShortBurst, unreadable
from drivers.recording.summary import RecordingSummary, summarise


class Recording:
    """A recording opened for reading; read through once when it is opened, checksums compared.

    Raises:
        RecordingError: the file cannot be read at all, or its frames do not decode.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._contents = read_contents(self.path)

    @property
    def metadata(self) -> dict[str, str]:
        """Run id, rig, camera serial, software version, as far as they were given."""
        return dict(self._contents.metadata.get(attachments.METADATA, {}))

    @property
    def frame_count(self) -> int:
        return len(self._contents.frames)

    @property
    def entries(self) -> list[FrameEntry]:
        """Every frame in file order, without its images."""
        return list(self._contents.frames)

    @property
    def topics(self) -> dict[str, TopicEntry]:
        """What is recorded, by topic without leading slash."""
        return dict(self._contents.topics)

    @property
    def attachments(self) -> dict[str, Attachment]:
        """Attached files by name; of several with one name, the last."""
        return dict(self._contents.attachments)

    def attachment(self, name: str) -> bytes | None:
        """Content of an attached file, or None where there is none."""
        found = self._contents.attachments.get(name)
        return None if found is None else found.data

    @property
    def configuration(self) -> str | None:
        """The configuration as used, TOML, or None."""
        content = self.attachment(attachments.CONFIGURATION)
        return None if content is None else content.decode()

    @cached_property
    def calibration(self) -> Calibration:
        """The attached calibration, else intrinsics and distortion of the last calibration message.

        Raises:
            RecordingError: there is neither, or the attachment is not a calibration.
        """
        attached = self.attachment(attachments.CALIBRATION)
        if attached is not None:
            return Calibration.from_toml(attached.decode(), f"{self.path}: {attachments.CALIBRATION}")
        said = [message for message, _ in self.messages([CAMERA_CALIBRATION])]
        if not said:
            raise RecordingError(
                f"{self.path}: holds no calibration; expected the attachment {attachments.CALIBRATION} or a "
                f"message on {CAMERA_CALIBRATION}: name a calibration file in the configuration"
            )
        return _calibration_of(said[-1])

    @cached_property
    def truth(self) -> NDArray[np.float32] | None:
        """(βH, βW) true distance of the reference view, metres, where the recording was simulated.

        Raises:
            RecordingError: the attachment cannot be read.
        """
        content = self.attachment(attachments.TRUTH)
        if content is None:
            return None
        try:
            with np.load(BytesIO(content)) as arrays:
                return np.asarray(arrays["distance"], dtype=np.float32)
        except (KeyError, ValueError, OSError, BadZipFile) as error:
            raise RecordingError(
                f"{self.path}: {attachments.TRUTH} cannot be read ({error}); expected the array `distance`"
            ) from error

    @property
    def _frames_per_burst(self) -> int | None:
        said = self.metadata.get(attachments.FRAMES_PER_BURST, "")
        return int(said) if said.isdecimal() and int(said) > 0 else None

    @cached_property
    def damage(self) -> Damage | None:
        """What cannot be read and what is missing for that reason; None for a whole recording."""
        found = self._contents
        if not (found.faults or found.incomplete or found.lost):
            return None
        sequences = [entry.sequence for entry in found.frames]
        between = set(range(min(sequences), max(sequences))) if sequences else set()
        return Damage(
            parts=tuple(unreadable(fault) for fault in found.faults),
            last_frame=sequences[-1] if sequences else None,
            lost_messages=dict(found.lost),
            lost_frames=tuple(sorted(between - set(sequences) - set(found.incomplete))),
            incomplete_frames=tuple(found.incomplete),
            short_bursts=_short_bursts(
                found.frames, self._frames_per_burst, any(fault.part == "end" for fault in found.faults)
            ),
        )

    def messages(self, topics: Iterable[str] | None = None) -> Iterator[tuple[Message, int]]:
        """Every message (or those of some topics) in file order, with its log time in ns."""
        wanted = None if topics is None else set(topics)
        for message, log_time in read_messages(self.path):
            if wanted is None or message.topic in wanted:
                yield message, log_time

    def frames(self) -> Iterator[Frame]:
        """Every whole frame in file order."""
        assembler = FrameAssembler()
        for message, _ in self.messages(FRAME_TOPICS):
            frame = assembler.add(message)
            if frame is not None:
                yield frame

    def bursts(self, frames_per_burst: int) -> Iterator[list[Frame]]:
        """Frames by burst: runs of one burst id; frames without one are cut every `frames_per_burst`.

        The last burst, or one that a damaged file cut short, comes with the frames there are.
        """
        if frames_per_burst < 1:
            raise ValueError(f"frames_per_burst: expected at least 1, got {frames_per_burst}")
        for burst, run in groupby(self.frames(), key=lambda frame: frame.burst):
            held: list[Frame] = []
            for frame in run:
                held.append(frame)
                if burst is None and len(held) == frames_per_burst:
                    yield held
                    held = []
            if held:
                yield held

    def summary(self) -> RecordingSummary:
        """What there is, for people and programs."""
        return summarise(self)

    def problem(self) -> str | None:
        """Why the frames cannot be fused as they are, in one line; None where nothing speaks against it."""
        entries = self._contents.frames
        if not entries:
            return (
                f"{self.path}: holds no whole frame; expected {', '.join(FRAME_TOPICS)}"
                + (f" ({self.damage})" if self.damage else "")
                + ": give a recording of a camera"
            )
        first = entries[0]
        for entry in entries:
            if entry.shape != first.shape:
                return (
                    f"{self.path}: frame {entry.sequence} has {_size(entry.shape)} pixels, frame "
                    f"{first.sequence} {_size(first.shape)}; expected one size: split the recording"
                )
        if attachments.CALIBRATION in self._contents.attachments and self.calibration.shape != first.shape:
            return (
                f"{self.path}: its calibration is for {_size(self.calibration.shape)} pixels, its frames "
                f"have {_size(first.shape)}: record again with the calibration of this camera"
            )
        return None


def open_recording(path: Path | str) -> Recording:
    """Open a recording of a camera and check that its frames can be fused.

    Raises:
        RecordingError: in one line, what is wrong, what was expected and what to do: no such file, empty, not
            MCAP, no whole frame, frames of several sizes, or of another size than the calibration's.
    """
    recording = Recording(path)
    problem = recording.problem()
    if problem is not None:
        raise RecordingError(problem)
    return recording


def _calibration_of(message: Message) -> Calibration:
    said = decode_calibration(message.payload)
    fx, _, cx, _, fy, cy, *_ = said.K
    return Calibration(
        width=said.width,
        height=said.height,
        intrinsics=Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy),
        distortion=tuple(said.D),
        source=f"message on {CAMERA_CALIBRATION}",
    )


def _short_bursts(frames: Sequence[FrameEntry], planned: int | None, is_torn: bool) -> tuple[ShortBurst, ...]:
    """Bursts with fewer frames than planned, or than the fullest where the plan is not known.

    The last burst of a file that is not torn may be short because the recording was stopped: it counts only
    where a pose is missing.
    """
    counts: defaultdict[int, int] = defaultdict(int)
    poses: defaultdict[int, int] = defaultdict(int)
    for entry in frames:
        if entry.burst is not None:
            counts[entry.burst] += 1
            poses[entry.burst] = max(poses[entry.burst], (entry.pose or 0) + 1)
    if not counts:
        return ()
    expected = planned or max(*counts.values(), *poses.values())
    last = frames[-1].burst
    short = [
        ShortBurst(burst=burst, frames=count, expected=expected)
        for burst, count in counts.items()
        if count < expected and not (burst == last and not is_torn and poses[burst] <= count)
    ]
    if is_torn and last is not None and len(counts) == 1 and planned is None and not short:
        short.append(ShortBurst(burst=last, frames=counts[last], expected=None))
    return tuple(short)


def _size(shape: tuple[int, int]) -> str:
    return f"{shape[0]} × {shape[1]}"
