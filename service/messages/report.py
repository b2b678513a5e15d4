"""What is said about one fused map: the payload of `fused/report`."""

from pydantic import BaseModel, ConfigDict, Field


class Phases(BaseModel):
    """Wall-clock time by phase."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    registration: float = Field(ge=0, description="Seconds spent on finding where the frames look.")
    solve: float = Field(ge=0, description="Seconds spent on the map itself.")
    total: float = Field(ge=0, description="Seconds from the frames to the finished map.")


class AxisGain(BaseModel):
    """How far one axis turned, for what the stage says."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    gain: float = Field(description="1 = as the stage says, 0 = not at all, negative = the wrong way.")
    deviation: float = Field(ge=0, description="One standard deviation of it.")


class MotionFound(BaseModel):
    """What the images say of the stage's motion; none for an axis that the plan does not turn far enough."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    pan: AxisGain | None = None
    tilt: AxisGain | None = None


class BurstReport(BaseModel):
    """How the fusion of one burst went."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    burst: int = Field(description="Number of the burst; in a stream, of the newest frame.")
    timestamp: int = Field(description="Mid-exposure of the reference frame, ns since the epoch.")
    frames: int = Field(ge=1, description="Frames given to the fusion.")
    missing: int = Field(ge=0, description="Frames that the plan has, but the burst has not.")
    sequence: tuple[int, ...] = Field(description="The camera's numbers of the frames given.")
    method: str = Field(description="Method used, never `auto`.")
    upsampling: int = Field(ge=1, description="β.")
    height: int = Field(ge=1, description="Rows of the map.")
    width: int = Field(ge=1, description="Columns of the map.")
    known: float = Field(ge=0, le=1, description="Share of the map's pixels that have a depth.")
    regularization: float | None = Field(description="λ used; none for methods without one.")
    iterations: int = Field(ge=0, description="Iterations of the solve.")
    objective: float | None = Field(description="Objective at the result; none for methods without one.")
    gap: float | None = Field(description="Relative duality gap; none for methods without one.")
    converged: bool = Field(description="Whether the solve met its tolerance within its iterations.")
    noise: float | None = Field(description="c in σ(distance) = c / amplitude, metres × amplitude.")
    deviation: float | None = Field(description="Median of the map's standard deviation, metres.")
    coverage: float = Field(
        ge=0, le=1, description="Share of the β × β sub-pixel cells that a frame falls in."
    )
    used: tuple[int, ...] = Field(description="Positions in the burst of the frames fused.")
    rejected: dict[int, str] = Field(description="Reason by position for those that were not.")
    contradicted: float = Field(
        0.0,
        ge=0,
        le=1,
        description="Share of the samples left out: the other frames contradict them, or they are too far.",
    )
    shifts: tuple[tuple[float, float], ...] = Field(
        description="(dy, dx) of each frame at the image centre, low-resolution pixels."
    )
    rotations: tuple[tuple[float, float, float], ...] | None = Field(
        description="Rotation vector of each frame, radians, camera axes; none where displacements were used."
    )
    motion: MotionFound | None = Field(
        None, description="How far the images say that the stage turned; none where that cannot be judged."
    )
    seconds: Phases
    notes: tuple[str, ...] = Field((), description="What else is to be said of it.")
    latency: float | None = Field(
        None,
        description="Seconds from the end of the last exposure to the map, of a replay from the arrival of "
        "the last frame; none outside the service.",
    )
