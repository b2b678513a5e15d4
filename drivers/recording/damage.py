"""What is missing from a recording, in numbers and in words."""

from collections.abc import Sequence
from itertools import pairwise

from pydantic import BaseModel, ConfigDict, Field

from drivers.messages import CAMERA_FRAME
from drivers.recording.arrangement import scans
from drivers.recording.assembly import FrameEntry
from drivers.recording.contents import Contents

_MOST_SAID = 8
"""Ranges, and bursts, that are listed one by one."""


class UnreadablePart(BaseModel):
    """A stretch of the file that cannot be read."""

    model_config = ConfigDict(frozen=True)

    part: str = Field(
        description="`chunk`, `attachment`, `record`, `index`, or `end` where the file is torn."
    )
    offset: int = Field(description="Where it begins, bytes.")
    length: int = Field(description="Bytes.")
    reason: str


class ShortBurst(BaseModel):
    """A burst with fewer frames than it should have."""

    model_config = ConfigDict(frozen=True)

    burst: int
    frames: int = Field(description="Frames that could be read.")
    expected: int | None = Field(
        description="As planned, or as the fullest has; null where the file is torn in its only burst."
    )


class Gap(BaseModel):
    """Numbers between two frames that are there, with unreadable bytes between them in the file."""

    model_config = ConfigDict(frozen=True)

    first: int = Field(description="Sequence.")
    last: int = Field(description="Sequence.")

    @property
    def size(self) -> int:
        return self.last - self.first + 1


class UnusableFrame(BaseModel):
    """A frame whose messages are there, but are not what they should be."""

    model_config = ConfigDict(frozen=True)

    sequence: int
    reason: str


class Damage(BaseModel):
    """Why a recording is not whole, and what it lacks."""

    model_config = ConfigDict(frozen=True)

    parts: tuple[UnreadablePart, ...] = ()
    last_frame: int | None = Field(None, description="Sequence of the last whole frame.")
    lost_messages: dict[str, int] = Field({}, description="Messages known to be lost, by topic.")
    lost_frames: tuple[Gap, ...] = Field(
        (), description="Where frames are missing; of the numbers, some may never have been recorded."
    )
    lost_frame_count: int | None = Field(None, description="How many are missing there; null = not known.")
    incomplete_frames: tuple[int, ...] = Field((), description="Sequences of frames that lack an image.")
    unusable_frames: tuple[UnusableFrame, ...] = ()
    short_bursts: tuple[ShortBurst, ...] = ()

    @property
    def is_torn(self) -> bool:
        """The file ends before its time: anything may have followed."""
        return any(part.part == "end" for part in self.parts)

    @property
    def unreadable_bytes(self) -> int:
        return sum(part.length for part in self.parts if part.part != "index")

    def _missing(self) -> str:
        listed = _listed([(gap.first, gap.last) for gap in self.lost_frames])
        if self.lost_frame_count == sum(gap.size for gap in self.lost_frames):
            return f"missing frames: {listed}"
        count = "some" if self.lost_frame_count is None else self.lost_frame_count
        return f"missing frames: {count} of {listed}"

    def __str__(self) -> str:
        said = [_describe(part) for part in self.parts]
        if self.is_torn:
            after = (
                "nothing but the head" if self.last_frame is None else f"all up to frame {self.last_frame}"
            )
            said.append(f"{after} can be read")
        if self.lost_frames:
            said.append(self._missing())
        if self.incomplete_frames:
            said.append(f"incomplete frames: {_listed(_runs(self.incomplete_frames))}")
        if self.unusable_frames:
            numbers = tuple(frame.sequence for frame in self.unusable_frames)
            said.append(f"unusable frames: {_listed(_runs(numbers))} ({self.unusable_frames[0].reason})")
        said.extend(_shortness(short) for short in self.short_bursts[:_MOST_SAID])
        if len(self.short_bursts) > _MOST_SAID:
            said.append(f"{len(self.short_bursts) - _MOST_SAID} more bursts are short")
        if self.lost_messages:
            said.append(
                "lost messages: "
                + ", ".join(f"{topic} {count}" for topic, count in self.lost_messages.items())
            )
        return "; ".join(said)


def assess(
    found: Contents,
    entries: Sequence[FrameEntry],
    bursts: Sequence[Sequence[FrameEntry]],
    planned: int | None,
) -> Damage | None:
    """What is wrong with a recording and what it lacks; None for a whole one.

    Args:
        found: what was read.
        entries: whole frames, in the order in which they come.
        bursts: the same, cut into bursts.
        planned: frames of a burst; None = not known.
    """
    if not (found.faults or found.incomplete or found.invalid or found.lost):
        return None
    parts = tuple(UnreadablePart.model_validate(fault, from_attributes=True) for fault in found.faults)
    return Damage(
        parts=parts,
        last_frame=entries[-1].sequence if entries else None,
        lost_messages=dict(found.lost),
        lost_frames=_gaps(parts, entries, found.incomplete),
        lost_frame_count=found.lost[CAMERA_FRAME] - found.fieldless if CAMERA_FRAME in found.lost else None,
        incomplete_frames=tuple(found.incomplete),
        unusable_frames=tuple(UnusableFrame(sequence=s, reason=reason) for s, reason in found.invalid),
        short_bursts=_short_bursts(bursts, planned, any(part.part == "end" for part in parts)),
    )


def _gaps(
    parts: Sequence[UnreadablePart], entries: Sequence[FrameEntry], incomplete: Sequence[int]
) -> tuple[Gap, ...]:
    """Gaps in the numbers with a fault at that place of the file; others were there when it was recorded."""
    offsets = [part.offset for part in parts if part.part in ("chunk", "record")]
    found = []
    for before, after in pairwise(entries):
        if after.sequence <= before.sequence + 1:
            continue
        if any(before.offset <= offset <= after.offset for offset in offsets):
            inside = [number for number in incomplete if before.sequence < number < after.sequence]
            steps = [before.sequence, *sorted(inside), after.sequence]
            found += [Gap(first=a + 1, last=b - 1) for a, b in pairwise(steps) if b - a > 1]
    return tuple(found)


def _short_bursts(
    bursts: Sequence[Sequence[FrameEntry]], planned: int | None, is_torn: bool
) -> tuple[ShortBurst, ...]:
    """Bursts with fewer frames than planned, or than the fullest of their scan where the plan is not known.

    The last burst of a file that is not torn may be short because the recording was stopped: it counts only
    where a pose is missing.
    """
    named = [burst for burst in bursts if burst[0].burst is not None]
    short: list[ShortBurst] = []
    for scan in scans(named):
        expected = planned or max(max(len(burst), _poses(burst)) for burst in scan)
        for burst in scan:
            is_last = burst is named[-1]
            if len(burst) < expected and not (is_last and not is_torn and _poses(burst) <= len(burst)):
                short.append(ShortBurst(burst=burst[0].burst or 0, frames=len(burst), expected=expected))
        if is_torn and scan[-1] is named[-1] and len(scan) == 1 and planned is None and not short:
            only = scan[0]
            short.append(ShortBurst(burst=only[0].burst or 0, frames=len(only), expected=None))
    return tuple(short)


def _poses(burst: Sequence[FrameEntry]) -> int:
    return 1 + max(entry.pose or 0 for entry in burst)


def _shortness(short: ShortBurst) -> str:
    if short.expected is None:
        return f"burst {short.burst} has {short.frames} frames, perhaps not all"
    return f"burst {short.burst} has {short.frames} of {short.expected} frames"


def _describe(part: UnreadablePart) -> str:
    if part.part == "end":
        return f"torn at byte {part.offset:,}, {part.length:,} bytes unusable ({part.reason})"
    if part.part == "index":
        return part.reason
    return f"damaged {part.part} of {part.length:,} bytes at byte {part.offset:,} ({part.reason})"


def _runs(numbers: Sequence[int]) -> list[tuple[int, int]]:
    """(3, 5), (9, 9) for 3, 4, 5, 9."""
    runs: list[tuple[int, int]] = []
    for number in sorted(numbers):
        if runs and number <= runs[-1][1] + 1:
            runs[-1] = runs[-1][0], number
        else:
            runs.append((number, number))
    return runs


def _listed(runs: Sequence[tuple[int, int]]) -> str:
    """`3-5, 9`; at most `_MOST_SAID`."""
    shown = [f"{first}" if first == last else f"{first}-{last}" for first, last in runs[:_MOST_SAID]]
    return ", ".join(shown) + (f" and {len(runs) - _MOST_SAID} more" if len(runs) > _MOST_SAID else "")
