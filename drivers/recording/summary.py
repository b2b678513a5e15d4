"""What a recording holds, for people and programs."""

from collections import Counter
from datetime import UTC, datetime
from itertools import pairwise
from math import degrees
from statistics import median
from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict, Field

from drivers.calibration import Calibration
from drivers.errors import RecordingError
from drivers.messages import FrameFields
from drivers.recording.contents import FrameEntry, TopicEntry
from drivers.recording.damage import Damage

if TYPE_CHECKING:
    from drivers.recording.reader import Recording


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True)


class TopicSummary(_Part):
    topic: str
    schema_name: str
    messages: int
    rate: float | None = Field(description="Messages per second of log time.")


class AttachmentSummary(_Part):
    name: str
    media_type: str
    size: int = Field(description="Bytes.")


class BurstSummary(_Part):
    burst: int | None = Field(description="Null = frames without a burst id.")
    frames: int
    pan: tuple[float, float] = Field(description="Smallest and largest angle, degrees.")
    tilt: tuple[float, float] = Field(description="Smallest and largest angle, degrees.")


class FramesSummary(_Part):
    count: int
    shape: tuple[int, int] = Field(description="Rows and columns.")
    duration: float = Field(description="From the first exposure to the last, seconds.")
    rate: float | None = Field(description="1 / the median time between frames, Hz.")
    drops: int = Field(description="Gaps in the camera's counter.")
    integration_times: list[float | None] = Field(description="Seconds per phase sample; null = not known.")
    modulation_frequencies: list[float] = Field(description="Hz.")
    ambiguity_ranges: list[float] = Field(description="Metres.")
    amplitude_modes: list[str]
    bursts: list[BurstSummary]


class RecordingSummary(_Part):
    """What `lidarboost info` shows."""

    path: str
    size: int = Field(description="Bytes.")
    start: datetime | None = Field(description="Log time of the first message.")
    duration: float = Field(description="From the first log time to the last, seconds.")
    metadata: dict[str, str]
    topics: list[TopicSummary]
    frames: FramesSummary | None
    calibration: Calibration | None
    calibration_problem: str | None = Field(description="Why there is no calibration.")
    truth: tuple[int, int] | None = Field(description="Rows and columns of the true distance.")
    attachments: list[AttachmentSummary]
    problem: str | None = Field(description="Why its frames cannot be fused as they are.")
    damage: Damage | None
    damage_text: str | None


def summarise(recording: "Recording") -> RecordingSummary:
    """Gather what is known of a recording; what is wrong with it becomes part of the summary."""
    topics = recording.topics
    first = min((entry.first for entry in topics.values()), default=None)
    last = max((entry.last for entry in topics.values()), default=0)
    calibration, calibration_problem = _calibration(recording)
    truth, damage = recording.truth, recording.damage
    return RecordingSummary(
        path=str(recording.path),
        size=recording.path.stat().st_size,
        start=None if first is None else datetime.fromtimestamp(first / 1e9, UTC),
        duration=0.0 if first is None else (last - first) / 1e9,
        metadata=recording.metadata,
        topics=[_topic(name, entry) for name, entry in sorted(topics.items())],
        frames=_frames(recording.entries) if recording.entries else None,
        calibration=calibration,
        calibration_problem=calibration_problem,
        truth=None if truth is None else (truth.shape[0], truth.shape[1]),
        attachments=[
            AttachmentSummary(name=name, media_type=found.media_type, size=len(found.data))
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


def _topic(name: str, entry: TopicEntry) -> TopicSummary:
    span = (entry.last - entry.first) / 1e9
    return TopicSummary(
        topic=name,
        schema_name=entry.schema.name,
        messages=entry.count,
        rate=(entry.count - 1) / span if span > 0 else None,
    )


def _frames(entries: list[FrameEntry]) -> FramesSummary:
    fields = [entry.fields for entry in entries]
    times = sorted(entry.timestamp for entry in fields)
    steps = [later - earlier for earlier, later in pairwise(times)]
    gaps = (later.sequence - earlier.sequence - 1 for earlier, later in pairwise(fields))
    return FramesSummary(
        count=len(entries),
        shape=entries[0].shape,
        duration=(times[-1] - times[0]) / 1e9,
        rate=1e9 / median(steps) if steps and median(steps) > 0 else None,
        drops=sum(gap for gap in gaps if gap > 0),
        integration_times=list(dict.fromkeys(entry.integration_time for entry in fields)),
        modulation_frequencies=list(dict.fromkeys(entry.modulation_frequency for entry in fields)),
        ambiguity_ranges=list(dict.fromkeys(entry.ambiguity_range for entry in fields)),
        amplitude_modes=list(dict.fromkeys(entry.amplitude_mode for entry in fields)),
        bursts=[_burst(burst, fields) for burst in Counter(entry.burst for entry in fields)],
    )


def _burst(burst: int | None, fields: list[FrameFields]) -> BurstSummary:
    members = [entry for entry in fields if entry.burst == burst]
    pan, tilt = [entry.pan for entry in members], [entry.tilt for entry in members]
    return BurstSummary(
        burst=burst,
        frames=len(members),
        pan=(degrees(min(pan)), degrees(max(pan))),
        tilt=(degrees(min(tilt)), degrees(max(tilt))),
    )
