"""How the service is doing: the payload of `status`."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

Source = Literal["device", "replay", "simulation"]
State = Literal["starting", "idle", "scanning", "streaming", "recovering", "stopping"]


class _Part(BaseModel):
    """Read too: what a newer service adds is passed over, what an older one lacks has its default."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class Degraded(_Part):
    """Something that does not work while the rest goes on."""

    what: str = Field(description="What is wrong.")
    remedy: str = Field("", description="What mends it.")
    seconds: float = Field(0.0, ge=0, description="For how long.")


class Drops(_Part):
    """What was lost since the service started, by cause."""

    camera: int = Field(0, ge=0, description="Frames that the camera took and that never arrived.")
    stale: int = Field(0, ge=0, description="Frames exposed before the stage stood still; not a fault.")
    faults: int = Field(0, ge=0, description="Frames or movements that failed and were tried again.")
    bursts: int = Field(0, ge=0, description="Bursts given up, or skipped because the fusion was behind.")
    skipped: int = Field(
        0, ge=0, description="Frames of a stream without a map of their own: the fusion was behind."
    )
    fusions: int = Field(0, ge=0, description="Bursts, or frames of a stream, whose fusion failed.")
    published: int = Field(0, ge=0, description="Events that the publisher had no room for.")
    recorded: int = Field(0, ge=0, description="Events that the recorder could not write.")


class Totals(_Part):
    """What was done since the service started."""

    frames: int = Field(0, ge=0, description="Frames captured.")
    bursts: int = Field(0, ge=0, description="Bursts completed.")
    fused: int = Field(0, ge=0, description="Maps fused.")
    unconverged: int = Field(0, ge=0, description="Maps among them whose solve did not converge.")


class Rates(_Part):
    """How fast, over the last ten seconds."""

    frames: float = Field(0.0, ge=0, description="Frames per second.")
    fused: float = Field(0.0, ge=0, description="Maps per second.")


class ClusterState(_Part):
    """The cluster that bursts are sent to."""

    address: str = Field("", description="Of its scheduler.")
    workers: int = Field(0, ge=0, description="Workers that fuse for this service; 0 = it is not in use.")
    fused: int = Field(0, ge=0, description="Maps that came from it.")
    returned: int = Field(
        0, ge=0, description="Bursts that it was given and did not fuse; they were fused here again."
    )
    error: str | None = Field(None, description="Why it is not in use; none = it is, or is being asked.")


class FusionState(_Part):
    """Who fuses."""

    executor: Literal["local", "cluster"] | str = Field(
        "local", description="Who fuses the next burst; frames of a stream are fused locally in any case."
    )
    cluster: ClusterState | None = Field(None, description="None = none is configured.")
    backlog: int = Field(0, ge=0, description="Bursts, or frames of a stream, that wait.")
    restarts: int = Field(0, ge=0, description="Times that the local process had to be started again.")
    hung: int = Field(0, ge=0, description="Times among them that it did not answer in time.")
    spare: bool = Field(False, description="Whether a second process stands ready.")
    error: str | None = Field(None, description="Its last fault; none = none, or maps have come since.")


class RecorderState(_Part):
    """What the recorder is doing."""

    recording: bool = Field(False, description="Whether it records.")
    file: str | None = Field(None, description="The file being written, or the last one.")
    size: int = Field(0, ge=0, description="Bytes in it.")
    messages: int = Field(0, ge=0, description="Messages written by this recorder.")
    lost: int = Field(0, ge=0, description="Messages that it could not write.")
    free: int | None = Field(None, description="Bytes free on the disk; none while nothing was recorded.")
    error: str | None = Field(None, description="Why nothing can be recorded at present; none = it can.")


class DiskState(_Part):
    """The disk that recordings go to."""

    directory: str = Field(description="Where recordings go.")
    free: int = Field(ge=0, description="Bytes free.")
    total: int = Field(ge=0, description="Bytes of the disk.")
    rate: float | None = Field(
        None, ge=0, description="Bytes a second that are recorded, over the last minute; none = nothing is."
    )
    minutes: float | None = Field(
        None,
        ge=0,
        description="Until the disk is full, or the budget is and the oldest recording goes; none = nothing "
        "is recorded.",
    )


class SinkState(_Part):
    """One of those that take the events."""

    name: str
    state: Literal["running", "restarting", "failed", "ended"] | str = Field(
        "running", description="Whether it works."
    )
    waiting: int = Field(0, ge=0, description="Events in its queue.")
    taken: int = Field(0, ge=0, description="Events worked off.")
    dropped: int = Field(0, ge=0, description="Events lost to it; of a recorder: messages.")
    faults: int = Field(0, ge=0, description="Times that it failed.")
    abandoned: int = Field(0, ge=0, description="Times that it hung and was given up.")
    error: str | None = Field(None, description="Why it does not run, or its last fault; none = none.")


class Drift(_Part):
    """How far the distance of what stands still is off that of the first map: cameras warm up."""

    distance: float = Field(description="Metres, > 0 farther.")
    deviation: float = Field(ge=0, description="One standard deviation of it, metres.")
    static: float = Field(ge=0, le=1, description="Share of the pixels that stand still.")
    seconds: float = Field(description="Since the first map.")


class Subscriber(_Part):
    """Somebody who says when messages are in hand."""

    who: str = Field("", description="As the subscriber calls itself.")
    topic: str = Field("", description="What it has subscribed to.")
    latency: float = Field(
        0.0,
        ge=0,
        description="Seconds from the end of the last exposure to its hands and back, median of the last 20.",
    )
    slowest: float = Field(0.0, ge=0, description="The most among these.")
    seconds: float = Field(0.0, ge=0, description="Since the last one.")


class CommandCounts(_Part):
    """What was asked of the service."""

    accepted: int = Field(0, ge=0, description="Commands carried out.")
    refused: dict[str, int] = Field({}, description="Commands refused, by code.")


class LastError(_Part):
    """What went wrong last; gone once it is over."""

    what: str = Field("", description="In words.")
    timestamp: int = Field(0, description="When it was seen, ns since the epoch.")


class InForce(_Part):
    """What the next burst is captured and fused with."""

    method: str = Field("unknown", description="Of the fusion.")
    upsampling: int = Field(0, ge=0, description="β.")
    regularization: float | str = Field("unknown", description="λ, or `auto`.")
    frames: int = Field(0, ge=0, description="Of a burst.")
    window: int = Field(0, ge=0, description="Frames of a stream that are fused together.")
    span: float = Field(0.0, ge=0, description="Width of the field of poses, low-resolution pixels.")
    pause: float = Field(0.0, ge=0, description="Seconds between the end of a burst and the next.")
    integration_time: float = Field(0.0, ge=0, description="Seconds per phase sample.")
    modulation_frequency: float = Field(0.0, ge=0, description="Of the camera's light, Hz; 0 = not said.")


class Status(_Part):
    """How the service is doing; once a second, and at once after a change of state."""

    timestamp: int = Field(0, description="When this was true, ns since the epoch.")
    version: str = Field("unknown", description="Version of the software.")
    state: State | str = Field("unknown", description="What it is doing.")
    reason: str = Field("", description="Why it is in that state.")
    paused: bool = Field(False, description="Whether it stands still between two poses.")
    seconds: float = Field(0.0, ge=0, description="For how long it has been in that state.")
    degraded: tuple[Degraded, ...] = Field((), description="What does not work meanwhile.")
    source: Source | str | None = Field(
        None, description="Where frames come from; none while there is no camera."
    )
    model: str | None = Field(None, description="What the camera is.")
    serial: str | None = Field(None, description="Its serial number.")
    uptime: float = Field(0.0, ge=0, description="Seconds since the start.")
    totals: Totals = Totals()
    rates: Rates = Rates()
    drops: Drops = Drops()
    fusion: FusionState = FusionState()
    latency: float | None = Field(
        None, description="Seconds from the end of the last exposure of the last burst to its map."
    )
    temperature: float | None = Field(None, description="Of the camera, °C; none = it gives none.")
    drift: Drift | None = Field(
        None, description="Of the distance of what stands still; none = not known, or nothing stands still."
    )
    recorder: RecorderState | None = Field(None, description="What is recorded; none = no recorder.")
    disk: DiskState | None = Field(None, description="Room for recordings; none = not known.")
    sinks: tuple[SinkState, ...] = Field((), description="Who takes the events, and how that goes.")
    subscribers: tuple[Subscriber, ...] = Field((), description="Those who send receipts.")
    commands: CommandCounts = CommandCounts()
    in_force: InForce = InForce()
    error: LastError | None = Field(
        None, description="The last error of capture or fusion; none = there is none, or it is over."
    )
