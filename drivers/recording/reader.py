"""Reading a recording back: the very same frames, and what is missing where it is damaged."""

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.frame import Frame
from drivers.messages import Message, decode_image
from drivers.recording import attachments
from drivers.recording.arrangement import arranged, cut, indistinct, scans
from drivers.recording.assembly import FRAME_TOPICS, FrameEntry, Place
from drivers.recording.calibrations import Calibrations
from drivers.recording.contents import Contents, FoundMessage, TopicEntry, read_contents, read_messages
from drivers.recording.damage import Damage, assess
from drivers.recording.locks import hold
from drivers.recording.payloads import Payloads
from drivers.recording.records import AttachmentEntry
from drivers.recording.summary import RecordingSummary, summarise
from drivers.recording.truth import unpack_truth

_LARGEST_ATTACHMENT = 256 << 20
"""Bytes of an attachment that is read: a calibration of 16 million pixels has some 160 MB."""


class Recording:
    """A recording opened for reading; read through once when it is opened, checksums compared.

    Frames come in the file's order, or by log time where the file was sorted otherwise. Images stay in the
    file and are fetched when they are asked for.

    Raises:
        RecordingError: the file cannot be read at all.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        hold(self, self.path)
        self._contents = read_contents(self.path)
        self._entries = arranged(self._contents.frames)
        self._calibrations = Calibrations(
            str(self.path),
            self.attached(attachments.CALIBRATION),
            self._contents.calibrations,
            partial(_load, self.path),  # a bound method would keep this object, and its lock, alive
        )

    @property
    def contents(self) -> Contents:
        """Everything that was found, as it is in the file."""
        return self._contents

    @cached_property
    def metadata(self) -> dict[str, str]:
        """Run id, rig, camera serial, software version, as far as they were given; the last of several."""
        own = [record.metadata for record in self._contents.metadata if record.name == attachments.METADATA]
        return dict(own[-1]) if own else {}

    @property
    def frame_count(self) -> int:
        return len(self._entries)

    @property
    def entries(self) -> Sequence[FrameEntry]:
        """Every frame, without its images, in the order in which they come."""
        return self._entries

    @property
    def topics(self) -> dict[str, TopicEntry]:
        """What is recorded, by topic without leading slash."""
        return dict(self._contents.topics)

    @property
    def attachments(self) -> dict[str, AttachmentEntry]:
        """Attached files by name, without their content; of several with one name, the last."""
        return {entry.name: entry for entry in self._contents.attachments}

    def attached(self, name: str) -> list[AttachmentEntry]:
        """All attached files of a name, in file order."""
        return [entry for entry in self._contents.attachments if entry.name == name]

    def attachment(self, name: str) -> bytes | None:
        """Content of an attached file, or None where there is none.

        Raises:
            RecordingError: it is larger than anything that is read here.
        """
        found = self.attachments.get(name)
        return None if found is None else self.load(found)

    def load(self, entry: AttachmentEntry) -> bytes:
        """Content of an attached file; raises as `attachment`."""
        return _load(self.path, entry)

    @property
    def configuration(self) -> str | None:
        """The configuration as used, TOML, or None."""
        content = self.attachment(attachments.CONFIGURATION)
        return None if content is None else content.decode(errors="replace")

    @property
    def calibration(self) -> Calibration:
        """The calibration of the first frame; raises as `calibration_of`."""
        return self._calibrations.at(self._entries[0].timestamp if self._entries else 0)

    def calibration_of(self, frame: Frame | FrameEntry) -> Calibration:
        """The calibration that belongs to a frame; the same object for all frames of one.

        Raises:
            RecordingError: there is none, one that is no calibration, or it is not said which.
        """
        return self._calibrations.at(frame.timestamp)

    @cached_property
    def truth(self) -> NDArray[np.float32] | None:
        """(βH, βW) true distance of the reference view, metres, where the recording was simulated.

        None where there are several, or several scans: it is not said which belongs to which.

        Raises:
            RecordingError: the attachment cannot be read.
        """
        found = {self.load(entry) for entry in self.attached(attachments.TRUTH)}
        if len(found) != 1 or len(scans(self.cut(None))) > 1:
            return None
        return unpack_truth(found.pop(), self.path)

    @cached_property
    def planned(self) -> int | None:
        """Frames of a whole burst, where the recording says it; None also where merged ones disagree."""
        said = {
            record.metadata.get(attachments.FRAMES_PER_BURST, "")
            for record in self._contents.metadata
            if record.name == attachments.METADATA
        }
        only = said.pop() if len(said) == 1 else ""
        return int(only) if only.isascii() and only.isdecimal() and int(only[:9]) > 0 else None

    @cached_property
    def damage(self) -> Damage | None:
        """What cannot be read and what is missing for that reason; None for a whole recording."""
        return assess(self._contents, self._entries, self.cut(None), self.planned)

    def messages(self, topics: Iterable[str] | None = None) -> Iterator[tuple[Message, int]]:
        """Every message (or those of some topics) in file order, with its log time in ns."""
        wanted = None if topics is None else set(topics)
        for found in self._found_messages():
            if wanted is None or found.topic in wanted:
                stored, schema = found.stored, self._contents.schema(found.channel)
                message = Message(found.topic, schema, found.payload, stored.publish_time, stored.sequence)
                yield message, stored.log_time

    def frames(self) -> Iterator[Frame]:
        """Every whole frame."""
        yield from self.fetch(self._entries)

    def fetch(self, entries: Iterable[FrameEntry]) -> Iterator[Frame]:
        """The frames of some entries, with their images."""
        with Payloads(self.path) as payloads:
            for entry in entries:
                place = entry.amplitude
                yield entry.fields.frame(
                    decode_image(payloads.read(entry.distance)),
                    None if place is None else decode_image(payloads.read(place)),
                )

    def cut(self, frames_per_burst: int | None) -> list[list[FrameEntry]]:
        """The bursts, without images: `BurstCutter` says what one is; None = those without an id are not cut.

        The last burst, or one that a damaged file cut short, comes with the frames there are.
        """
        return cut(self._entries, frames_per_burst, self._known_calibration)

    def bursts(self, frames_per_burst: int) -> Iterator[list[Frame]]:
        """Frames by burst, as `cut` has them."""
        for entries in self.cut(frames_per_burst):
            yield list(self.fetch(entries))

    def summary(self) -> RecordingSummary:
        """What there is, for people and programs."""
        return summarise(self)

    def problem(self) -> str | None:
        """Why the frames cannot be fused as they are, in one line; None where nothing speaks against it."""
        if not self._entries:
            return (
                f"{self.path}: holds no whole frame; expected {', '.join(FRAME_TOPICS)}"
                + (f" ({self.damage})" if self.damage else "")
                + ": give a recording of a camera"
            )
        twice = indistinct(self._entries)
        if twice is not None:
            return (
                f"{self.path}: has two frames of number {twice.sequence} at one time; recordings of the same "
                "time were merged and cannot be told apart: use them as they were before"
            )
        return self._unfit_size()

    def _unfit_size(self) -> str | None:
        """What does not fit of the frames' sizes: with calibrations they may change, without they may not."""
        first = self._entries[0]
        for entry in self._entries:
            known = self._known_calibration(entry)
            if known is None and entry.shape != first.shape:
                return (
                    f"{self.path}: frame {entry.sequence} has {_size(entry.shape)} pixels, frame "
                    f"{first.sequence} {_size(first.shape)}; expected one size: split the recording"
                )
            if known is not None and known.shape != entry.shape:
                return (
                    f"{self.path}: frame {entry.sequence} has {_size(entry.shape)} pixels, its calibration "
                    f"is for {_size(known.shape)}: record again with the calibration of this camera"
                )
        return None

    def _known_calibration(self, entry: FrameEntry) -> Calibration | None:
        """The calibration of a frame, or None where none can be had; bursts are cut without it then."""
        try:
            return self.calibration_of(entry)
        except RecordingError:
            return None

    def _found_messages(self) -> Iterator[FoundMessage]:
        contents = Contents(schemas=dict(self._contents.schemas), channels=dict(self._contents.channels))
        try:
            with self.path.open("rb") as file:
                yield from read_messages(file, contents)
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be read again ({error}); open it again") from error


def open_recording(path: Path | str) -> Recording:
    """Open a recording of a camera and check that its frames can be fused.

    Raises:
        RecordingError: in one line, what is wrong, what was expected and what to do: no such file, empty, not
            MCAP, no whole frame, frames of another size than their calibration, or merged recordings of one
            time.
    """
    recording = Recording(path)
    problem = recording.problem()
    if problem is not None:
        raise RecordingError(problem)
    return recording


def _size(shape: tuple[int, int]) -> str:
    return f"{shape[0]} × {shape[1]}"


def _load(path: Path, entry: AttachmentEntry) -> bytes:
    if entry.size > _LARGEST_ATTACHMENT:
        raise RecordingError(
            f"{path}: {entry.name} has {entry.size:,} bytes; expected at most {_LARGEST_ATTACHMENT:,}"
        )
    with Payloads(path) as payloads:
        return payloads.read(Place(None, entry.data_offset, entry.data_offset + entry.size))
