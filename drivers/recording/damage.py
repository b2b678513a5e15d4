"""What is missing from a recording, in numbers and in words."""

from pydantic import BaseModel, ConfigDict, Field

from drivers.recording.container import Fault


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


class Damage(BaseModel):
    """Why a recording is not whole, and what it lacks."""

    model_config = ConfigDict(frozen=True)

    parts: tuple[UnreadablePart, ...] = ()
    last_frame: int | None = Field(None, description="Sequence of the last whole frame.")
    lost_messages: dict[str, int] = Field({}, description="Messages known to be lost, by topic.")
    lost_frames: tuple[int, ...] = Field((), description="Sequences missing between frames that are there.")
    incomplete_frames: tuple[int, ...] = Field((), description="Sequences of frames that lack an image.")
    short_bursts: tuple[ShortBurst, ...] = ()

    @property
    def is_torn(self) -> bool:
        """The file ends before its time: anything may have followed."""
        return any(part.part == "end" for part in self.parts)

    @property
    def unreadable_bytes(self) -> int:
        return sum(part.length for part in self.parts if part.part != "index")

    def __str__(self) -> str:
        said = [_describe(part) for part in self.parts]
        if self.is_torn:
            after = (
                "nothing but the head" if self.last_frame is None else f"all up to frame {self.last_frame}"
            )
            said.append(f"{after} can be read")
        if self.lost_frames:
            said.append(f"missing frames: {_ranges(self.lost_frames)}")
        if self.incomplete_frames:
            said.append(f"incomplete frames: {_ranges(self.incomplete_frames)}")
        said.extend(_shortness(short) for short in self.short_bursts)
        if self.lost_messages:
            said.append(
                "lost messages: "
                + ", ".join(f"{topic} {count}" for topic, count in self.lost_messages.items())
            )
        return "; ".join(said)


def unreadable(fault: Fault) -> UnreadablePart:
    """A fault as it is reported."""
    return UnreadablePart(part=fault.part, offset=fault.offset, length=fault.length, reason=fault.reason)


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


def _ranges(numbers: tuple[int, ...]) -> str:
    """`3-5, 9` for 3, 4, 5, 9; at most eight ranges."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    shown = [f"{first}" if first == last else f"{first}-{last}" for first, last in runs[:8]]
    return ", ".join(shown) + (f" and {len(runs) - 8} more" if len(runs) > 8 else "")
