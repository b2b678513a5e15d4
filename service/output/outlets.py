"""Where results go: the publisher, the recorders and the pictures, opened together and closed in order."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from drivers.messages import Message
from drivers.recording import RecordingHead
from service.config import Configuration
from service.fusion.fusion import FusedBurst
from service.output.directory import free_path, made_directory
from service.output.previews import Previews
from service.output.recorder import Recorder
from service.output.shelf import Shelf, SingleFile
from service.topics import FUSED_POINTS
from service.wire.messages import points_message
from service.wire.publisher import Publisher
from service.wire.session import open_session

FUSED_FILE = "fused.mcap"


class Outlets:
    """Sends the same messages to the publisher and to every recorder.

    Args:
        publisher: to Zenoh.
        shelf: the recorder that may be started and stopped while the service runs.
        file: the recorder of `--output`, or None.
        previews: pictures, or None.
    """

    def __init__(
        self, publisher: Publisher, shelf: Recorder, file: Recorder | None, previews: Previews | None
    ) -> None:
        self.publisher, self.shelf, self.file, self.previews = publisher, shelf, file, previews
        self.published = 0
        self._counting = Lock()
        self._undelivered = False

    @property
    def recorders(self) -> list[Recorder]:
        """One or both."""
        return [self.shelf] if self.file is None else [self.shelf, self.file]

    def send(self, messages: Sequence[Message]) -> None:
        """Publish and record messages that belong together."""
        self.publisher.publish(messages)
        with self._counting:
            self.published += len(messages)
        for recorder in self.recorders:
            recorder.record(messages)

    def send_fused(self, result: FusedBurst, messages: Sequence[Message]) -> None:
        """A fused map: its messages, its points where somebody wants them, its picture."""
        self.send(messages)
        self.publisher.publish_lazily(FUSED_POINTS, lambda: points_message(result))
        if self.previews is not None:
            self.previews.draw(result)

    def settle(self, timeout: float) -> None:
        """Draw, write and hand over all that was sent."""
        if self.previews is not None:
            self.previews.close()
        self._undelivered = not self.publisher.drain(timeout)
        for recorder in self.recorders:
            recorder.stop()

    @property
    def files(self) -> list[Path]:
        """What was written, complete."""
        written = [Path(r.state.file) for r in self.recorders if r.state.file is not None]
        return written + (self.previews.written if self.previews is not None else [])

    @property
    def lost(self) -> list[str]:
        """What did not get out, in words; complete once settled."""
        said = [
            f"{count} messages on {topic} not published" for topic, count in self.publisher.dropped.items()
        ]
        if self._undelivered:
            said.append("a subscriber did not take everything that was published")
        states = [recorder.state for recorder in self.recorders]
        said += [
            f"{state.dropped} messages not recorded ({state.error or 'the disk was too slow'})"
            for state in states
            if state.dropped or state.error
        ]
        if self.previews is not None and self.previews.failed:
            said.append(f"{len(self.previews.failed)} previews not drawn")
        return said


@contextmanager
def open_outlets(
    configuration: Configuration,
    output: Path | None,
    head: Callable[[], RecordingHead],
    truth: NDArray[np.float32] | None,
    *,
    lossless: bool,
) -> Iterator[Outlets]:
    """Everything that the configuration and `--output` ask for.

    Args:
        configuration: sections zenoh, recording and output.
        output: directory of the one file and the pictures; None = neither.
        head: what every recording begins with.
        truth: true distance (βH, βW), for the pictures.
        lossless: whoever sends waits for slow disks and subscribers.

    Raises:
        SessionError: no Zenoh session.
        OutputError, StorageError: a file or folder cannot be made.
    """
    with ExitStack() as stack:
        session = stack.enter_context(open_session(file=configuration.zenoh.config))
        shelf = Recorder(Shelf(configuration.recording, time.time_ns), head)
        stack.callback(shelf.stop)
        if configuration.recording.enabled:
            shelf.start()
        file = previews = None
        if output is not None:
            stack.enter_context(made_directory(output))
            file = stack.enter_context(_file(output, head, lossless))
            if configuration.output.preview:
                previews = Previews(output, truth, lossless=lossless)
                stack.callback(previews.close)
        publisher = stack.enter_context(Publisher(session, configuration.zenoh.prefix, lossless=lossless))
        yield Outlets(publisher, shelf, file, previews)


@contextmanager
def _file(directory: Path, head: Callable[[], RecordingHead], lossless: bool) -> Iterator[Recorder]:
    """The recorder of the one file; after an error nothing of it is left."""
    recorder = Recorder(SingleFile(free_path(directory / FUSED_FILE)), head, lossless=lossless)
    recorder.start()
    try:
        yield recorder
    except BaseException:
        recorder.discard()
        raise
    recorder.stop()
