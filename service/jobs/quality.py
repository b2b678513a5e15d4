"""Bursts of one view, to be judged: of a recording, or of a file of maps."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from drivers.calibration import Calibration
from drivers.documents import parse_json
from drivers.errors import RecordingError
from drivers.frame import Frame
from drivers.recording import Recording
from drivers.recording.assembly import FrameEntry
from service.config.sections import FusionSection
from service.errors import ConfigurationError
from service.evaluation.sight import Sight, Take
from service.jobs.export import Arrays, fused_maps
from service.jobs.fuse import fused_bursts, recorded_bursts
from service.messages.report import BurstReport
from service.messages.topics import FUSED_CALIBRATION, FUSED_REPORT
from solver.geometry.points import distance_from_depth

_TURNED = float(np.radians(0.05))
"""By as much as a stage that came back to a pose may report other angles: a sixth of a pixel."""

_SHIFTED = 0.25
"""Pixels by which two frames of the same view may differ."""

_NEAR = 15 * 60 * 10**9
"""ns between a map and its frames at most; numbers of frames come again in merged files."""


@dataclass(frozen=True)
class Footage:
    """Bursts of one view.

    Attributes:
        takes: at least one, of one size.
        method: how they were fused, or None = not said.
        frames: of all bursts.
        notes: what is to be said of them.
        failures: bursts that could not be fused, and why.
    """

    takes: tuple[Take, ...]
    method: str | None
    frames: int
    notes: tuple[str, ...] = ()
    failures: tuple[str, ...] = ()


def fused_now(
    recording: Recording,
    settings: FusionSection,
    most: int,
    calibration: Calibration | None = None,
    advance: Callable[[], None] = lambda: None,
) -> Footage:
    """Fuse the first `most` bursts of a recording, but those that cannot be fused.

    Raises:
        RecordingError: frames that do not fit their calibration.
        FusionError: none of them can be fused.
    """
    takes, method, frames = [], None, 0
    failures: list[str] = []

    def failed(why: str) -> None:
        failures.append(why)
        advance()

    bursts = islice(recorded_bursts(recording, settings, calibration), most)
    for burst, result in fused_bursts(recording, bursts, settings, failed=failed):
        advance()
        lens = burst.calibration.distortion or None
        after = Sight(result.distance, result.intrinsics, lens)
        takes.append(take_of(burst.frames, burst.calibration, after, result.report.shifts))
        method, frames = result.report.method, frames + len(burst.frames)
    return replace(of_one_view(takes, method, frames), failures=tuple(failures))


def fused_before(recording: Recording, most: int, calibration: Calibration | None = None) -> Footage:
    """The first `most` maps of a file that have no frame in common, with their frames where it has them.

    Raises:
        RecordingError: no map, or maps without their calibration.
    """
    reports = dict(_reports(recording))
    takes, method, frames = [], None, 0
    seen: set[int] = set()
    for found in fused_maps(recording):
        at = int(found["timestamp"])
        report = reports.get(at)
        numbers = set(report.sequence) if report is not None else set()
        if seen & numbers:
            continue  # maps of a stream share frames, and with them their noise
        seen |= numbers
        entries = [entry for entry in recording.entries if _belongs(entry, at, numbers)]
        entries.sort(key=lambda entry: entry.timestamp != at)  # the reference first
        known = (calibration or recording.calibration_of(entries[0])) if entries else None
        after = _sight_of(found, recording)
        images = list(recording.fetch(entries))
        if known is None:
            takes.append(Take((), after))
        else:
            shifts = {} if report is None else dict(zip(report.sequence, report.shifts, strict=False))
            nowhere = (0.0, 0.0)
            takes.append(take_of(images, known, after, [shifts.get(f.sequence, nowhere) for f in images]))
        method = report.method if report is not None else method
        frames += max(len(numbers), len(entries))
        if len(takes) == most:
            break
    if not takes:
        raise RecordingError(f"{recording.path}: holds neither frames nor fused maps; nothing to judge")
    return of_one_view(takes, method, frames)


def take_of(
    frames: Sequence[Frame], calibration: Calibration, after: Sight, shifts: Sequence[tuple[float, float]]
) -> Take:
    """One burst, the reference first; of its frames those that look where that does.

    Args:
        frames: of the burst.
        calibration: of their camera.
        after: the map.
        shifts: (dy, dx) of each frame as they were registered, pixels: nobody may tell that a camera moves.
    """
    reference = frames[0]
    matrix, lens = calibration.intrinsics.matrix, calibration.distortion or None
    before = tuple(
        Sight(calibration.correct(frame.distance, frame.ambiguity_range), matrix, lens)
        for frame, shift in zip(frames, shifts, strict=True)
        if _is_near((frame.pan, frame.tilt), (reference.pan, reference.tilt))
        and np.hypot(shift[0] - shifts[0][0], shift[1] - shifts[0][1]) < _SHIFTED
    )
    return Take(before, after, reference.signal, (reference.pan, reference.tilt))


def of_one_view(takes: Sequence[Take], method: str | None, frames: int) -> Footage:
    """Those that look where the first does and have its size; a note tells of the others.

    Raises:
        ConfigurationError: maps whose size is no multiple of a frame's.
    """
    first = takes[0]
    _check_sizes(first)
    kept = [
        take
        for take in takes
        if (take.after.distance.shape, take.shape) == (first.after.distance.shape, first.shape)
        and (first.pose is None or take.pose is None or _is_near(first.pose, take.pose))
    ]
    notes: tuple[str, ...] = ()
    if len(kept) < len(takes):
        notes = (f"{len(takes) - len(kept)} of {len(takes)} bursts look elsewhere and are left out",)
    return Footage(tuple(kept), method, frames, notes)


def _check_sizes(take: Take) -> None:
    if not take.before:
        return
    frame, fused = take.before[0].distance.shape, take.after.distance.shape
    factor = fused[0] // frame[0]
    if factor < 1 or (frame[0] * factor, frame[1] * factor) != fused:
        raise ConfigurationError(
            f"a map of {fused[0]} × {fused[1]} pixels is no multiple of its frames' {frame[0]} × {frame[1]}"
        )


def _reports(recording: Recording) -> Iterator[tuple[int, BurstReport]]:
    for message, _ in recording.messages([FUSED_REPORT]):
        try:
            yield message.publish_time, BurstReport.model_validate(parse_json(message.payload))
        except ValueError as error:
            raise RecordingError(f"{recording.path}: a {FUSED_REPORT} is none ({error})") from error


def _belongs(entry: FrameEntry, at: int, numbers: set[int]) -> bool:
    if not numbers:
        return entry.timestamp == at
    return entry.sequence in numbers and abs(entry.timestamp - at) < _NEAR


def _sight_of(found: Arrays, recording: Recording) -> Sight:
    if "intrinsics" not in found:
        raise RecordingError(f"{recording.path}: its fused maps have no {FUSED_CALIBRATION}")
    lens = tuple(found["distortion"].tolist()) if found["distortion"].any() else None
    return Sight(distance_from_depth(found["depth"], found["intrinsics"], lens), found["intrinsics"], lens)


def _is_near(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return max(abs(a - b) for a, b in zip(one, other, strict=True)) <= _TURNED
