"""How far a scan is: the payload of `scan/progress`."""

from pydantic import BaseModel, ConfigDict, Field


class SolveProgress(BaseModel):
    """The solve at work."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    burst: int = Field(0, description="Number of the burst.")
    iteration: int = Field(0, ge=0, description="Iterations done.")
    limit: int = Field(0, ge=0, description="Iterations at most; most solves need far fewer.")
    gap: float | None = Field(None, description="Relative duality gap; none = not known on the way.")


class ScanProgress(BaseModel):
    """The burst at work."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    timestamp: int = Field(0, description="Mid-exposure of the newest frame, ns since the epoch.")
    burst: int = Field(0, description="Number of the burst.")
    poses: int | None = Field(None, description="Poses of the whole burst; none = not known.")
    captured: int = Field(0, ge=0, description="Poses captured so far.")
    seconds: float | None = Field(
        None, ge=0, description="Until it is captured, as the poses so far took; none = not known."
    )
    fusing: int = Field(0, ge=0, description="Bursts that wait for their map, or are being fused.")
    fusion: SolveProgress | None = Field(None, description="The solve at work; none = there is none.")
