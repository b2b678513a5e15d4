"""`cmd/record`: recordings begun, ended, kept, listed, fetched and saved."""

import time
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

from drivers.errors import RecordingError
from drivers.recording import Recording, recover, recovered_path
from service.daemon.desk import Desk
from service.daemon.recording import begin_recorder
from service.daemon.verb import Answer, Command, Outcome, Place, Reply, Verb
from service.errors import (
    InvalidArgumentError,
    InvalidStateError,
    IoFailureError,
    NotFoundError,
    OutOfRangeError,
    UnavailableError,
)
from service.messages.events import Delivery
from service.messages.status import RecorderState
from service.sinks.folder import found_in
from service.sinks.recorder import RECORDER, Recorder
from service.sinks.recording_directory import RecordedFile, RecordingDirectory
from service.sinks.recording_order import RecordingOrder, Wish
from service.wire.encoding import Octets

_BEGINS = 5.0
"""Seconds in which a recorder begins its file, or says why it cannot."""

_LARGEST_PART = 4_000_000

_FILE = Field(min_length=1, max_length=255, description="In the recording folder.")


class Part(BaseModel):
    """A piece of a file; its bytes follow the reply."""

    model_config = ConfigDict(frozen=True)

    file: str
    offset: int = Field(description="Where it begins, bytes.")
    size: int = Field(description="Its bytes.")
    total: int = Field(description="Bytes of the whole file.")


class Recovered(BaseModel):
    """What a torn recording still held."""

    model_config = ConfigDict(frozen=True)

    file: str = Field(description="The whole recording that was made.")
    frames: int
    messages: int
    lost: str | None = Field(description="What could not be saved; null = nothing was missing.")


class RecordReply(Reply):
    """What is recorded."""

    recorder: RecorderState = Field(description="What the recorder does.")
    recordings: tuple[RecordedFile, ...] | None = Field(None, description="Newest first; of `list`.")
    more: int | None = Field(None, description="Recordings that `list` has left out.")
    part: Part | None = Field(None, description="What follows; of `fetch`.")
    recovered: Recovered | None = Field(None, description="Of `recover`.")


class Start(Verb):
    """Begin to record."""

    place: ClassVar[Place] = "aside"
    action: Literal["start"]
    maps: bool | None = Field(None, description="Fused maps too, not frames alone; null = as configured.")
    replays: bool = Field(False, description="Also what is played from a recording.")

    def carry_out(self, desk: Desk) -> Answer:
        section = desk.daemon.configuration.recording
        maps = section.maps if self.maps is None else self.maps
        if desk.is_playing and not self.replays:
            raise InvalidStateError(
                'a recording is played, which is recorded only if asked for: {"replays": true}, or end the '
                "replay first"
            )
        order, wish = _recorder(desk).order, Wish(maps, self.replays)
        if order.wish is not None and order.wish != wish:
            raise InvalidStateError("it records already, in another way: stop that first")
        if order.wish is None:
            order.wish = wish
            desk.daemon.emit(Delivery(lambda: None))  # it begins with whatever event comes next
            _await_file(desk, order)
        return _reply(desk)


class Stop(Verb):
    """End the recording; answered once the file is complete."""

    place: ClassVar[Place] = "aside"
    action: Literal["stop"]

    def carry_out(self, desk: Desk) -> Answer:
        bus, section = desk.daemon.bus, desk.daemon.configuration.recording
        recorder = bus.sink(RECORDER)
        if isinstance(recorder, Recorder) and recorder.order.wish is None:
            return _reply(desk)
        ended = begin_recorder(bus, section, None)
        if ended is not None and ended.abandoned:
            raise IoFailureError(f"the recorder was given up: {ended.error}")
        last = recorder.state if isinstance(recorder, Recorder) else RecorderState()
        return desk.reply(RecordReply, recorder=last)


class Keep(Verb):
    """Never delete a recording to make room, or do so again."""

    place: ClassVar[Place] = "aside"
    action: Literal["keep"]
    file: str | None = Field(
        None, min_length=1, max_length=255, description="null = the one being written, or the last."
    )
    keep: bool = Field(True, description="Whether it is kept.")

    def carry_out(self, desk: Desk) -> Answer:
        directory = _directory(desk)
        if self.file is not None:
            path = found_in(directory.directory, self.file)
        else:
            latest = directory.files(_written(desk))
            if not latest:
                raise NotFoundError("nothing is recorded yet")
            path = directory.directory / latest[0].file
        directory.keep(path, self.keep)
        return _reply(desk)


class List(Verb):
    """The recordings there are, newest first."""

    place: ClassVar[Place] = "aside"
    changes: ClassVar[bool] = False
    action: Literal["list"]
    count: int = Field(100, ge=1, le=1000, description="At most so many.")

    def carry_out(self, desk: Desk) -> Answer:
        found = _directory(desk).files(_written(desk))
        return _reply(desk, recordings=tuple(found[: self.count]), more=max(0, len(found) - self.count))


class Fetch(Verb):
    """Part of a recording: its bytes follow the reply, the file's name is their attachment."""

    place: ClassVar[Place] = "aside"
    changes: ClassVar[bool] = False
    action: Literal["fetch"]
    file: str = _FILE
    offset: int = Field(0, ge=0, description="Bytes before it.")
    size: int = Field(1_000_000, ge=1, le=_LARGEST_PART, description="At most so many bytes.")

    def carry_out(self, desk: Desk) -> Answer:
        path = found_in(_directory(desk).directory, self.file)
        _refuse_written(desk, path)
        with path.open("rb") as file:
            total = file.seek(0, 2)
            if self.offset > total:
                raise OutOfRangeError(f"offset = {self.offset}: {self.file} has {total} bytes")
            file.seek(self.offset)
            content = file.read(self.size)
        part = Part(file=self.file, offset=self.offset, size=len(content), total=total)
        return Outcome(_reply(desk, part=part), (Octets(self.file, content),))


class Recover(Verb):
    """Make a whole recording of what a torn one still holds; that one stays as it is."""

    place: ClassVar[Place] = "aside"
    action: Literal["recover"]
    file: str = _FILE

    def carry_out(self, desk: Desk) -> Answer:
        path = found_in(_directory(desk).directory, self.file)
        _refuse_written(desk, path)
        target = recovered_path(path)
        if target.exists():
            raise InvalidStateError(f"{target.name} is there already: fetch that")
        try:
            recording = Recording(path)
            messages = recover(recording, target)
        except RecordingError as error:
            raise InvalidArgumentError(str(error)) from error
        made = Recovered(
            file=target.name,
            frames=recording.frame_count,
            messages=messages,
            lost=None if recording.damage is None else str(recording.damage),
        )
        return _reply(desk, recovered=made)


def _directory(desk: Desk) -> RecordingDirectory:
    return RecordingDirectory(desk.daemon.configuration.recording, time.time_ns)


def _written(desk: Desk) -> Path | None:
    """The file that this service is writing."""
    recorder = desk.daemon.bus.sink(RECORDER)
    return recorder.written if isinstance(recorder, Recorder) else None


def _refuse_written(desk: Desk, path: Path) -> None:
    written = _written(desk)
    if written is not None and written.resolve() == path:
        raise InvalidStateError(f"{path.name} is being written: stop the recording first")


def _recorder(desk: Desk) -> Recorder:
    """The recorder at work; raises `UnavailableError` where it is being started again."""
    recorder = desk.daemon.bus.sink(RECORDER)
    if not isinstance(recorder, Recorder):
        raise UnavailableError("the recorder failed and is started again: try again in a moment")
    return recorder


def _await_file(desk: Desk, order: RecordingOrder) -> None:
    """Wait until the recorder has begun a file; where it cannot, nothing is wanted of it any more."""
    end = time.monotonic() + _BEGINS
    while time.monotonic() < end and _written(desk) is None:
        recorder = desk.daemon.bus.sink(RECORDER)
        if isinstance(recorder, Recorder) and recorder.fault is not None:
            fault, order.wish = recorder.fault, None
            raise IoFailureError(f"nothing can be recorded: {fault}")
        time.sleep(0.01)


def _reply(desk: Desk, **fields: object) -> RecordReply:
    recorder = desk.daemon.bus.sink(RECORDER)
    state = recorder.state if isinstance(recorder, Recorder) else RecorderState()
    return desk.reply(RecordReply, recorder=state, **fields)


COMMAND = Command(
    "cmd/record",
    "Recordings: begun, ended, kept, listed, fetched and saved.",
    (Start, Stop, Keep, List, Fetch, Recover),
    RecordReply,
)
