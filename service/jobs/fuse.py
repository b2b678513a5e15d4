"""Fuses a recording without any service around it."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path

from drivers.bursts import ExpectedFrames
from drivers.calibration import Calibration
from drivers.messages import calibration_message, frame_messages
from drivers.recording import Recording, RecordingWriter, attachments
from service.config.sections import FusionSection
from service.fusion.fuse import fuse_burst
from service.messages.burst import Burst
from service.messages.encoding import fused_messages
from service.messages.map import FusedMap
from service.messages.viewing import Extras
from solver.errors import FusionError
from solver.result import Progress

Announce = Callable[[Burst], Progress | None]
"""Told of each burst before it is fused; gives back whom the solver tells how far it is."""


def recorded_bursts(
    recording: Recording, settings: FusionSection, calibration: Calibration | None = None
) -> Iterator[Burst]:
    """The bursts of a recording, each with its own calibration unless another is given.

    One without a number of its own is numbered from 0. `ExpectedFrames` says what one lacks.

    Raises:
        RecordingError: no calibration, or frames that do not fit it.
    """
    expected = ExpectedFrames(settings.frames, recording.planned)
    for number, frames in enumerate(recording.bursts(settings.frames)):
        first = frames[0]
        known = calibration or recording.calibration_of(first)
        name = number if first.burst is None else first.burst
        yield Burst(name, tuple(frames), known, expected.of(frames))


def fused_bursts(
    recording: Recording,
    bursts: Iterable[Burst],
    settings: FusionSection,
    announce: Announce = lambda _: None,
    failed: Callable[[str], None] = lambda _: None,
) -> Iterator[tuple[Burst, FusedMap]]:
    """Fuse burst after burst of a recording; one that cannot be fused is told and passed over.

    Args:
        recording: where they come from.
        bursts: what to fuse.
        settings: how.
        announce: told of each burst.
        failed: told which burst could not be fused, and why.

    Raises:
        FusionError: none of them can be fused.
    """
    fused, why = 0, None
    for burst in bursts:
        try:
            result = fuse_burst(burst, settings, announce(burst))
        except FusionError as error:
            why = f"burst {burst.id} not fused: {error}"
            failed(why)
            continue
        fused += 1
        yield burst, result
    if why is not None and not fused:
        raise FusionError(f"{recording.path}: no burst could be fused: {why}")


def fuse_recording(
    recording: Recording,
    settings: FusionSection,
    calibration: Calibration | None = None,
    output: Path | None = None,
    extras: Extras = Extras(),  # noqa: B008 — frozen
    announce: Announce = lambda _: None,
    finish: Callable[[RecordingWriter], None] = lambda _: None,
    failed: Callable[[str], None] = lambda _: None,
) -> Iterator[FusedMap]:
    """Fuse burst after burst; with `output`, write frames and maps into a recording, whole or not at all.

    A burst that cannot be fused is told and passed over.

    Messages get the times of the frames for their log times, so that the result depends on the input alone.

    Args:
        recording: what to fuse.
        settings: how.
        calibration: replaces the recording's own.
        output: MCAP file to write.
        extras: what is written of each map beside it.
        announce: told of each burst.
        finish: called with the whole `output` before it is closed.
        failed: told which burst could not be fused, and why.

    Raises:
        RecordingError: no calibration, or frames that do not fit it.
        FusionError: no burst can be fused.
        StorageError: the file cannot be written.
    """
    with ExitStack() as stack:
        writer = None
        if output is not None:
            writer = stack.enter_context(RecordingWriter(output, recording.metadata, whole=True))
            _copy_attachments(recording, writer)
        bursts = recorded_bursts(recording, settings, calibration)
        for burst, result in fused_bursts(recording, bursts, settings, announce, failed):
            if writer is not None:
                _write(writer, burst, result, extras)
            yield result
        if writer is not None:
            finish(writer)


def _copy_attachments(recording: Recording, writer: RecordingWriter) -> None:
    for name in (attachments.CONFIGURATION, attachments.TRUTH):
        for entry in recording.attached(name):
            writer.attach(name, recording.load(entry), entry.media_type, entry.log_time)


def _write(writer: RecordingWriter, burst: Burst, result: FusedMap, extras: Extras) -> None:
    writer.attach_calibration(burst.calibration, burst.reference.timestamp)
    for frame in burst.frames:
        for message in frame_messages(frame, burst.calibration.mount):
            writer.write(message, frame.timestamp)
    writer.write(
        calibration_message(burst.calibration, burst.reference.timestamp), burst.frames[-1].timestamp
    )
    for message in (*fused_messages(result), *extras.messages(result)):
        writer.write(message, burst.frames[-1].timestamp)
