"""What a recording holds, for people and programs."""

from collections.abc import Sequence
from datetime import UTC, datetime
from itertools import pairwise
from math import degrees
from statistics import median
from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict, Field

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.messages import FrameFields
from drivers.names import Shown
from drivers.recording import attachments
from drivers.recording.assembly import FrameEntry
from drivers.recording.contents import TopicEntry
from drivers.recording.damage import Damage

if TYPE_CHECKING:
    from drivers.recording.reader import Recording


_TURNED = 1e-5
"""Radians between two poses; the finest stage here makes steps of ten times as much."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True)


class TopicSummary(_Part):
    topic: str
    schema_name: str = Field(description="Of the topic's messages; several are joined by commas.")
    messages: int
    rate: float | None = Field(description="Messages per second of log time.")


class AttachmentSummary(_Part):
    name: str
    media_type: str
    size: int = Field(description="Bytes.")


class BurstSummary(_Part):
    burst: int | None = Field(description="Null = frames without a burst id.")
    frames: int
    shape: tuple[int, int] = Field(description="Rows and columns.")
    start: int = Field(description="Timestamp of the first frame, ns since the epoch.")
    pan: tuple[float, float] = Field(description="Smallest and largest angle, degrees.")
    tilt: tuple[float, float] = Field(description="Smallest and largest angle, degrees.")


class FramesSummary(_Part):
    count: int
    shape: tuple[int, int] = Field(description="Rows and columns of the first.")
    duration: float = Field(description="From the first exposure to the last, seconds.")
    rate: float | None = Field(description="1 / the median time between frames, Hz.")
    drops: int = Field(description="Gaps in the camera's counter while it looked one way.")
    passed: int = Field(description="Gaps in it while the stage turned, and between bursts: nobody's loss.")
    integration_times: list[float | None] = Field(description="Seconds per phase sample; null = not known.")
    modulation_frequencies: list[float | None] = Field(description="Hz; null = none, or not known.")
    ambiguity_ranges: list[float | None] = Field(description="Metres; null = none, or not known.")
    amplitude_modes: list[str] = Field(description="`none` = the camera gives no amplitude.")
    bursts: list[BurstSummary]


class RecordingSummary(_Part):
    """What `lidarboost info` shows."""

    path: Shown
    size: int = Field(description="Bytes.")
    start: datetime | None = Field(description="Log time of the first message.")
    duration: float = Field(description="From the first log time to the last, seconds.")
    metadata: dict[str, str]
    topics: list[TopicSummary]
    frames: FramesSummary | None
    calibration: Calibration | None
    calibration_problem: Shown | None = Field(description="Why there is no calibration.")
    truth: tuple[int, int] | None = Field(description="Rows and columns of the true distance.")
    truth_problem: str | None = Field(description="Why a truth that is there cannot be used.")
    attachments: list[AttachmentSummary]
    problem: Shown | None = Field(description="Why its frames cannot be fused as they are.")
    damage: Damage | None
    damage_text: Shown | None


def summarise(recording: "Recording") -> RecordingSummary:
    """Gather what is known of a recording; what is wrong with it becomes part of the summary."""
    topics = recording.topics
    first = min((entry.first for entry in topics.values()), default=None)
    last = max((entry.last for entry in topics.values()), default=0)
    calibration, calibration_problem = _calibration(recording)
    truth, truth_problem = _truth(recording)
    damage = recording.damage
    return RecordingSummary(
        path=str(recording.path),
        size=recording.path.stat().st_size,
        start=None if first is None else datetime.fromtimestamp(first / 1e9, UTC),
        duration=0.0 if first is None else (last - first) / 1e9,
        metadata=recording.metadata,
        topics=[_topic(name, entry) for name, entry in sorted(topics.items())],
        frames=_frames(recording) if recording.entries else None,
        calibration=calibration,
        calibration_problem=calibration_problem,
        truth=truth,
        truth_problem=truth_problem,
        attachments=[
            AttachmentSummary(name=name, media_type=found.media_type, size=found.size)
            for name, found in sorted(recording.attachments.items())
        ],
        problem=recording.problem(),
        damage=damage,
        damage_text=None if damage is None else str(damage),
    )


def _calibration(recording: "Recording") -> tuple[Calibration | None, str | None]:
    try:
        return recording.calibration, None
    except RecordingError as error:
        return None, str(error)


def _truth(recording: "Recording") -> tuple[tuple[int, int] | None, str | None]:
    try:
        truth = recording.truth
    except RecordingError as error:
        return None, str(error)
    if truth is not None:
        return (truth.shape[0], truth.shape[1]), None
    if recording.attached(attachments.TRUTH):
        return None, "it is not said which belongs to which of several scans"
    return None, None


def _topic(name: str, entry: TopicEntry) -> TopicSummary:
    span = (entry.last - entry.first) / 1e9
    return TopicSummary(
        topic=name,
        schema_name=", ".join(entry.schemas),
        messages=entry.count,
        rate=(entry.count - 1) / span if span > 0 else None,
    )


def _frames(recording: "Recording") -> FramesSummary:
    entries = recording.entries
    fields = [entry.fields for entry in entries]
    times = sorted(entry.timestamp for entry in fields)
    steps = [later - earlier for earlier, later in pairwise(times)]
    bursts = recording.cut(None)
    drops, passed = _gaps(bursts)
    return FramesSummary(
        count=len(entries),
        shape=entries[0].shape,
        duration=(times[-1] - times[0]) / 1e9,
        rate=1e9 / median(steps) if steps and median(steps) > 0 else None,
        drops=drops,
        passed=passed,
        integration_times=list(dict.fromkeys(entry.integration_time for entry in fields)),
        modulation_frequencies=list(dict.fromkeys(entry.modulation_frequency for entry in fields)),
        ambiguity_ranges=list(dict.fromkeys(entry.ambiguity_range for entry in fields)),
        amplitude_modes=list(dict.fromkeys(_amplitude(entry) for entry in fields)),
        bursts=[_burst(burst) for burst in bursts],
    )


def _amplitude(fields: FrameFields) -> str:
    return fields.amplitude_mode if fields.has_amplitude else "none"


def _gaps(bursts: Sequence[Sequence[FrameEntry]]) -> tuple[int, int]:
    """Frames that are missing where the camera looked one way, and those that passed meanwhile."""
    drops = passed = 0
    entries = [(number, entry.fields) for number, burst in enumerate(bursts) for entry in burst]
    for (burst, earlier), (next_burst, later) in pairwise(entries):
        gap = max(0, later.sequence - earlier.sequence - 1)
        turned = max(abs(later.pan - earlier.pan), abs(later.tilt - earlier.tilt)) > _TURNED
        if turned or burst != next_burst:
            passed += gap
        else:
            drops += gap
    return drops, passed


def _burst(members: Sequence[FrameEntry]) -> BurstSummary:
    pan, tilt = [entry.fields.pan for entry in members], [entry.fields.tilt for entry in members]
    return BurstSummary(
        burst=members[0].burst,
        frames=len(members),
        shape=members[0].shape,
        start=members[0].timestamp,
        pan=(degrees(min(pan)), degrees(max(pan))),
        tilt=(degrees(min(tilt)), degrees(max(tilt))),
    )
