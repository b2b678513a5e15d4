"""Recording what is published, byte for byte."""

import json
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

from drivers.messages import Message
from drivers.recording import RecordingHead, attachments
from service.config.sections import RecordingSection
from service.errors import EncodingError
from service.messages.encoding import event_messages
from service.messages.events import (
    BurstCaptured,
    Commanded,
    Event,
    FrameCaptured,
    HeadChanged,
    MapFused,
)
from service.messages.status import RecorderState
from service.messages.topics import TOPICS
from service.messages.viewing import Extras
from service.sinks.destination import Destination
from service.sinks.preroll import Preroll
from service.sinks.recording_directory import RecordingDirectory
from service.sinks.recording_file import Unit
from service.sinks.recording_order import RecordingOrder, Wish
from service.sinks.recording_series import RecordingSeries
from service.sinks.recovery import Recovery
from service.sinks.sink import Room, Sink

RECORDER = "recorder"
"""How the one that writes into the recording folder is called."""

_MOST_WAITING = 64 << 20
"""Bytes that wait for a file."""


class Recorder(Sink):
    """Writes the recorded topics of every event; a file begins once it is known what the devices are.

    What belongs together (the messages of one event) is written, or lost, as one. A disk that is full,
    read-only, taken away or not there stops the recording alone: what was written is kept, what comes
    meanwhile waits for as long as the pre-roll is and is counted as lost thereafter, and every second it is
    tried again. While nothing is wanted, the pre-roll alone is kept.

    Args:
        destination: a `RecordingDirectory` or a `FileSeries`.
        order: what is wanted; None = all, always.
        extras: what is written of each map beside it.
        preroll: seconds before its start that a recording begins with.
        now: nanoseconds since the epoch, when a message was received.
    """

    room = Room(4096, 128 << 20)
    """Twenty seconds of a camera at 50 frames/s: more than a disk that is busy with something else takes."""
    droppable = (MapFused, FrameCaptured)
    unit: ClassVar[str] = "messages"

    def __init__(
        self,
        destination: Destination,
        *,
        order: RecordingOrder | None = None,
        extras: Extras = Extras(),  # noqa: B008 — frozen
        preroll: float = 0.0,
        now: Callable[[], int] = time.time_ns,
    ) -> None:
        super().__init__()
        self._destination, self._now = destination, now
        self.order = order if order is not None else RecordingOrder(Wish(replays=True))
        self.extras = extras
        self._has_preroll = preroll > 0
        self._waiting = Preroll(preroll, _MOST_WAITING)
        self._series = RecordingSeries(destination, self._waiting, now)
        self._recovery: Recovery | None = None
        self._was_wanted = False

    def take(self, event: Event) -> None:
        series = self._series
        if isinstance(event, HeadChanged):
            self._change(event.head)
        if series.head is None or self.abandoned.is_set():
            return
        wish = self.order.wish
        if wish is not None and self._may_be_recorded(wish):
            self._begin(wish)
            self._queue(event, wish)
            self._recover_once()
            series.write()
            self._note(event)
            series.lost += self._waiting.forget(time.monotonic())
            return
        self._was_wanted = False
        series.finish()
        series.fault = None
        if self._has_preroll and self._may_be_recorded(wish or Wish()):
            self._queue(event, Wish())
            self._waiting.forget(time.monotonic())

    def close(self) -> None:
        """Complete the file; after a failure what was written before is kept."""
        if self._recovery is not None:
            self._recovery.stop()
        if self.is_wanted and self._waiting.first is not None:
            self._series.write(at_once=True)
            self._series.lost += self._waiting.clear()
        self._series.finish()

    def discard(self) -> None:
        """Leave nothing of the file behind; those that are complete stay."""
        if self._recovery is not None:
            self._recovery.stop()
        self._series.discard()

    @property
    def is_wanted(self) -> bool:
        """Whether it shall record."""
        wish = self.order.wish
        return wish is not None and self._may_be_recorded(wish)

    @property
    def files(self) -> tuple[str, ...]:
        return self._series.files

    @property
    def fault(self) -> str | None:
        return self._series.fault

    @property
    def lost(self) -> int:
        return self._series.lost

    @property
    def losses(self) -> tuple[str, ...]:
        return self._series.losses

    def worth(self, event: Event) -> int:
        wish = self.order.wish
        if wish is None or not self._may_be_recorded(wish):
            return 0
        with suppress(EncodingError):
            return len(self._recorded(event, wish))
        return 1

    @property
    def written(self) -> Path | None:
        """The file at work, as it is called until it is complete."""
        return self._series.written

    @property
    def state(self) -> RecorderState:
        """What it is doing."""
        return self._series.state

    def _may_be_recorded(self, wish: Wish) -> bool:
        """Whether what comes is no replay, or replays are asked for."""
        head = self._series.head
        return wish.replays or head is None or head.metadata.get("source") != "replay"

    def _begin(self, wish: Wish) -> None:
        """Of the pre-roll only what is wanted goes into the file."""
        if not self._was_wanted and not wish.maps:
            self._waiting.keep(lambda unit: not unit.is_map)
        self._was_wanted = True

    def _change(self, head: RecordingHead) -> None:
        """Have the next file begin with this; the one at work ends where frames come from elsewhere now."""
        before = self._series.head
        if before is not None and _origin(before) != _origin(head):
            self._series.finish()
            gone = self._waiting.clear()
            self._series.lost += gone if self.is_wanted else 0
        self._series.head = head

    def _queue(self, event: Event, wish: Wish) -> None:
        messages = self._recorded(event, wish)
        if messages:
            begins = isinstance(event, BurstCaptured)
            is_map = isinstance(event, MapFused)
            self._waiting.append(Unit(messages, self._now(), time.monotonic(), begins, is_map))

    def _recorded(self, event: Event, wish: Wish) -> tuple[Message, ...]:
        if isinstance(event, MapFused) and not wish.maps:
            return ()
        extras = self.extras.of(event) if isinstance(event, MapFused) else ()
        return (*(m for m in event_messages(event) if TOPICS[m.topic].recorded), *extras)

    def _recover_once(self) -> None:
        """See to what an earlier run left, before there is a file of this one's own."""
        if self._recovery is None:
            try:
                left = self._destination.leftovers()
            except OSError:  # there is no folder yet
                left = []
            self._recovery = Recovery(left, self._destination.make_room)
            self._recovery.start()

    def _note(self, event: Event) -> None:
        """Put down who had what done."""
        if isinstance(event, Commanded):
            self._series.note("command", _told(event))


def recorder_of(section: RecordingSection, order: RecordingOrder) -> Recorder:
    """The recorder of a service: files in the recording folder."""
    return Recorder(
        RecordingDirectory(section, time.time_ns),
        order=order,
        extras=Extras(section.points, section.depth_mm),
        preroll=section.preroll,
    )


def order_of(section: RecordingSection) -> RecordingOrder:
    """What is recorded from the start, as configured."""
    return RecordingOrder(wish_of(section) if section.enabled else None)


def wish_of(section: RecordingSection) -> Wish:
    """What is recorded where nothing else is said."""
    return Wish(section.maps, section.replays)


def _origin(head: RecordingHead) -> tuple[object, ...]:
    """Whose frames they are, and by which calibration."""
    told = tuple(head.metadata.get(name) for name in ("source", "camera_model", "camera_serial"))
    return *told, *(content for name, content, _ in head.attachments if name == attachments.CALIBRATION)


def _told(event: Commanded) -> dict[str, str]:
    return {
        "who": event.who,
        "when": str(event.timestamp),
        "command": event.command,
        "arguments": json.dumps(event.arguments),
    }
