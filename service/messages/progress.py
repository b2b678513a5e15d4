"""How far a scan is: the payload of `scan/progress`."""

from pydantic import BaseModel, ConfigDict, Field


class SolverProgress(BaseModel):
    """A solve on its way."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    burst: int = Field(description="Number of the burst that is being fused.")
    iteration: int = Field(ge=0, description="Iterations so far, of the pass at work.")
    objective: float | None = Field(None, description="What is being minimised; none = not known.")
    gap: float | None = Field(None, description="Relative duality gap; none for methods without one.")


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
    solver: SolverProgress | None = Field(
        None, description="The solve at work; none = none, or not heard of yet."
    )
