"""Everything that is published: the one table that publisher, recorder, documentation and tests read.

Zenoh key = `<prefix>/<topic>`; topic in a recording = `/<topic>`; the bytes are the same.
"""

from dataclasses import dataclass
from enum import Enum

from drivers.messages import (
    CAMERA_AMPLITUDE,
    CAMERA_CALIBRATION,
    CAMERA_DISTANCE,
    CAMERA_FRAME,
    STAGE_TRANSFORM,
)

FUSED_DEPTH = "fused/depth"
FUSED_DEVIATION = "fused/deviation"
FUSED_AMPLITUDE = "fused/amplitude"
FUSED_REASON = "fused/reason"
FUSED_CALIBRATION = "fused/calibration"
FUSED_TRANSFORM = "fused/transform"
FUSED_DEPTH_MM = "fused/depth_mm"
FUSED_POINTS = "fused/points"
FUSED_REPORT = "fused/report"
SCAN_PROGRESS = "scan/progress"
REPLAY_STATE = "replay/state"
STATUS = "status"
LOG = "log"
ALIVE = "alive"

FUSED_FRAME_ID = "fused"
"""The axes of the reference frame of the latest map: right, down, forward."""


class Congestion(Enum):
    """What becomes of a message on a link that is full."""

    DROP = "drop"
    """It is lost for that subscriber: images, of which the next one is worth more."""
    AHEAD = "ahead"
    """It goes ahead of all images, in a queue of its own of 1 MB for each subscriber, and is lost where even
    that is full; whoever asks for history and recovery gets the last ones later. For small messages."""
    NONE = "–"
    """Not a publication."""


@dataclass(frozen=True, slots=True)
class Topic:
    """One row of the table.

    Attributes:
        name: without prefix or leading slash.
        schema: name of the schema.
        rate: how often, in words.
        recorded: whether a running recorder writes it.
        congestion: what becomes of it on a full link.
        latest: late subscribers and `get` receive the last value.
        description: what it is.
        unit: of its values.
    """

    name: str
    schema: str
    rate: str
    recorded: bool
    congestion: Congestion
    latest: bool
    description: str
    unit: str = "–"


_DROP, _AHEAD, _NONE = Congestion.DROP, Congestion.AHEAD, Congestion.NONE

_ROWS = (
    Topic(
        CAMERA_DISTANCE,
        "foxglove.RawImage",
        "each frame",
        True,
        _DROP,
        False,
        "16UC1, radial counts; metres = counts · `scale`, else ambiguity range / 65536 (`camera/frame`), "
        "0 = rejected; or 32FC1, radial, metres",
        unit="counts",
    ),
    Topic(
        CAMERA_AMPLITUDE,
        "foxglove.RawImage",
        "each frame",
        True,
        _DROP,
        False,
        "mono16, amplitude, counts, where the camera gives one",
        unit="counts",
    ),
    Topic(
        CAMERA_FRAME,
        "lidarboost.Frame",
        "each frame",
        True,
        _DROP,
        False,
        "JSON: times, angles, settings, burst and pose of the frame",
        unit="SI",
    ),
    Topic(
        CAMERA_CALIBRATION,
        "foxglove.CameraCalibration",
        "at start and each burst",
        True,
        _AHEAD,
        True,
        "intrinsics of the camera's own images",
        unit="pixels",
    ),
    Topic(
        STAGE_TRANSFORM,
        "foxglove.FrameTransform",
        "each frame",
        True,
        _DROP,
        False,
        "`rig` (x forward, y left, z up) to `camera` (optical)",
        unit="m",
    ),
    Topic(
        FUSED_DEPTH,
        "foxglove.RawImage",
        "each fusion",
        True,
        _DROP,
        True,
        "32FC1, Z in metres, NaN = unknown (REP 118), β times the camera's rows and columns",
        unit="m",
    ),
    Topic(
        FUSED_DEVIATION,
        "foxglove.RawImage",
        "each fusion",
        True,
        _DROP,
        True,
        "32FC1, one standard deviation of the depth, metres",
        unit="m",
    ),
    Topic(
        FUSED_AMPLITUDE,
        "foxglove.RawImage",
        "each fusion",
        True,
        _DROP,
        True,
        "32FC1, amplitude per second of integration time, where the method gives one",
        unit="counts/s",
    ),
    Topic(
        FUSED_REASON,
        "foxglove.RawImage",
        "each fusion",
        True,
        _DROP,
        True,
        "8UC1: 0 measured, 1 filled; unknown: 2 dark, 3 saturated, 4 contradicted, 5 outside",
    ),
    Topic(
        FUSED_CALIBRATION,
        "foxglove.CameraCalibration",
        "each fusion",
        True,
        _AHEAD,
        True,
        "intrinsics of the fused images",
        unit="pixels",
    ),
    Topic(
        FUSED_TRANSFORM,
        "foxglove.FrameTransform",
        "each fusion",
        True,
        _AHEAD,
        True,
        "`rig` to `fused`: where the reference frame looked, in whose axes the map lies",
        unit="m",
    ),
    Topic(
        FUSED_DEPTH_MM,
        "foxglove.RawImage",
        "each fusion, while somebody listens or a recording asks",
        True,
        _DROP,
        True,
        "16UC1, depth in millimetres, 0 = unknown, lens distortion taken out: for viewers",
        unit="mm",
    ),
    Topic(
        FUSED_POINTS,
        "foxglove.PointCloud",
        "each fusion, while somebody listens or a recording asks",
        True,
        _DROP,
        True,
        "x, y, z (metres, `fused`), amplitude, deviation; float32, known pixels only, thinned in recordings",
        unit="m",
    ),
    Topic(
        FUSED_REPORT,
        "lidarboost.BurstReport",
        "each fusion",
        True,
        _AHEAD,
        True,
        "JSON: method, λ, iterations, frames used and rejected, noise, seconds, latency",
        unit="SI",
    ),
    Topic(
        SCAN_PROGRESS,
        "lidarboost.ScanProgress",
        "each pose, and 5 Hz during a solve",
        False,
        _DROP,
        True,
        "JSON: how far the burst at work is, what is being fused, and how far the solver is",
        unit="SI",
    ),
    Topic(
        REPLAY_STATE,
        "lidarboost.ReplayState",
        "5 Hz while a replay plays, else 1 Hz, and at once after a change",
        False,
        _AHEAD,
        True,
        "JSON: what is played, where it is, how fast, and gaps of its clock",
        unit="SI",
    ),
    Topic(
        STATUS,
        "lidarboost.Status",
        "1 Hz",
        True,
        _AHEAD,
        True,
        "JSON: state, source, rates, drops by cause, disk, last error",
        unit="SI",
    ),
    Topic(LOG, "foxglove.Log", "as it happens", True, _AHEAD, True, "the service's log"),
    Topic(ALIVE, "–", "liveliness token", False, _NONE, False, "present as long as the service runs"),
)

TOPICS: dict[str, Topic] = {row.name: row for row in _ROWS}
"""Every topic by name."""


def topic_table() -> str:
    """The table as Markdown, as it stands on the page for subscribers."""
    lines = ["| topic | schema | when | recorded | full link | latest | what |", "|" + "---|" * 7]
    for row in _ROWS:
        cells = (
            f"`{row.name}`",
            row.schema,
            row.rate,
            "yes" if row.recorded else "no",
            row.congestion.value,
            "kept" if row.latest else "–",
            row.description,
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)
