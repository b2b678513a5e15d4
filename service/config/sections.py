"""The configuration: every section and field, with its unit, bounds and default."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from drivers.settings import CameraSettings
from service.config.section import Section
from service.config.served import (
    FoxgloveSection,
    LogSection,
    MetricsSection,
    Ros2Section,
    SinkSection,
    WebSection,
)
from solver.options import FusionOptions, Method

Preset = Literal["fine", "fast", "far", "dark"]
"""Names of the presets; `service.config.presets` has what they set."""


class CameraSection(Section):
    """Where frames come from."""

    backend: str = Field(
        "auto", description="Backend; `auto` = the first real camera found, else the recording named here."
    )
    recording: Path | None = Field(None, description="What `auto` plays where there is no real camera.")
    options: dict[str, Any] = Field({}, description="Options of the backend itself; it checks them.")
    settings: CameraSettings | None = Field(
        None, description="Settings to put in force; those not named stay as the camera has them."
    )
    calibration: Path | None = Field(
        None, description="TOML file that replaces the calibration the camera brings along."
    )
    timeout: float = Field(2.0, gt=0, le=60, description="Seconds to wait for a frame before it is lost.")


class StageSection(Section):
    """What turns the camera."""

    backend: str = Field("none", description="Backend; `none` = the camera stands still, or turns by itself.")
    options: dict[str, Any] = Field({}, description="Options of the backend itself; it checks them.")
    resolution: float = Field(0.0, ge=0, le=5, description="Smallest step, degrees; 0 = as the stage says.")
    settle: float = Field(
        0.05, ge=0, le=10, description="Seconds to stand still after a movement before a frame counts."
    )
    timeout: float = Field(
        10.0, gt=0, le=300, description="Seconds that a movement may take longer than at the stage's speed."
    )
    home: Literal["ask", "at start", "never"] = Field(
        "ask",
        description="When a stage that does not know where it is may find its reference, for which it moves "
        "beyond the plan: `ask` = by --home or an answer on the terminal; `at start` = whenever it is "
        "opened, again at most twice; `never`.",
    )


class PlanSection(Section):
    """Where the camera looks in the course of one burst."""

    span: float = Field(
        1.0, ge=0, le=40, description="Width of the field of poses, end to end, low-resolution pixels."
    )
    axes: Literal["pan", "both"] = Field(
        "both", description="Turn in pan only, or in pan and, where the stage can, in tilt."
    )
    pan: float = Field(0.0, ge=-180, le=180, description="Centre of the poses, degrees, > 0 left.")
    tilt: float = Field(0.0, ge=-90, le=90, description="Centre of the poses, degrees, > 0 up.")
    nearest: float = Field(
        1.0, gt=0, le=1000, description="Range of the nearest things in view, metres, to estimate parallax."
    )
    farthest: float = Field(
        5.0, gt=0, le=1000, description="Range of the farthest things in view, metres, to estimate parallax."
    )
    pause: float = Field(0.0, ge=0, le=86400, description="Seconds between the end of a burst and the next.")

    @model_validator(mode="after")
    def _nearest_is_nearer(self) -> Self:
        if self.nearest > self.farthest:
            raise ValueError(f"nearest {self.nearest:g} m must not be beyond farthest {self.farthest:g} m")
        return self


class FusionSettings(Section):
    """How frames become one map: what a job carries, and what `cmd/fusion` may change."""

    frames: int = Field(15, ge=1, le=200, description="Frames of one burst.")
    method: Method = Field("auto", description="`auto` = `phasor` where there is amplitude, else `area`.")
    upsampling: int = Field(4, ge=1, le=16, description="β: fused pixels per sensor pixel, along each axis.")
    regularization: Annotated[float, Field(gt=0, le=1e9)] | Literal["auto"] = Field(
        "auto",
        description="λ, metres (`phasor`: a factor on its penalties, 1 = auto); `auto` = from the noise.",
    )
    tolerance: float = Field(1e-3, gt=0, lt=1, description="Relative error at which the solve stops.")
    max_iterations: int = Field(1000, ge=1, le=1_000_000, description="Most iterations of one solve.")
    amplitude_threshold: Annotated[float, Field(ge=0, le=1e9)] | Literal["auto"] = Field(
        "auto",
        description="Counts per second of integration time under which a sample is not used; 0 = none.",
    )
    fill: float = Field(
        5.0, ge=0, le=1000, description="How far unseen parts are filled in, low-resolution pixels."
    )
    register_poses: bool = Field(
        True, description="Find the rotations from the data; false = trust the stage's angles."
    )
    backlog: int = Field(
        2, ge=1, le=100, description="Bursts that may wait; live, the oldest goes when full."
    )
    timeout: float = Field(120.0, ge=1, le=86400, description="Seconds one fusion may take.")

    def options(self) -> FusionOptions:
        """The same choices as the solver takes them."""
        return FusionOptions(
            method=self.method,
            upsampling=self.upsampling,
            regularization=self.regularization,
            tolerance=self.tolerance,
            max_iterations=self.max_iterations,
            amplitude_threshold=self.amplitude_threshold,
            fill=self.fill,
        )


class FusionSection(FusionSettings):
    """How frames become one map, and who makes it."""

    executor: Literal["local", "cluster"] = Field(
        "local",
        description="Who fuses the bursts of a scan: a process of this machine, or a Dask cluster "
        "(`lidarboost[cluster]`), for which that process stands in while it is away. Streams stay here.",
    )
    cluster: str | None = Field(
        None,
        pattern=r"^[a-z]+://\S+:\d{1,5}$",
        description="Address of the cluster's scheduler, such as tcp://10.0.0.7:8786. Its workers run what "
        "they are sent and this service believes what they answer: trusted networks only.",
    )

    @model_validator(mode="after")
    def _cluster_has_an_address(self) -> Self:
        if self.executor == "cluster" and self.cluster is None:
            raise ValueError(
                'executor "cluster" needs the address of its scheduler: cluster = "tcp://HOST:8786"'
            )
        return self


class StreamSection(Section):
    """How frames become a map each."""

    window: int = Field(15, ge=1, le=200, description="Frames that are fused together: the newest ones.")


class ZenohSection(Section):
    """How results are published."""

    prefix: str = Field(
        "lidarboost/rig", pattern=r"^[^/*$#?\s]+(/[^/*$#?\s]+)*$", description="What every key begins with."
    )
    config: Path | None = Field(
        None, description="Zenoh's own JSON5 file; none = a peer that listens on tcp/127.0.0.1:7447."
    )
    raw_rate: float | None = Field(
        None,
        gt=0,
        le=1000,
        description="Raw frames published per second at most, for thin links; none = all. Recordings and "
        "fusion have all in any case.",
    )


class RecordingSection(Section):
    """What is kept on disk while the service runs."""

    enabled: bool = Field(False, description="Record from the start, without being asked.")
    directory: Path = Field(Path("recordings"), description="Where the files go.")
    rotate_size: float = Field(1024.0, ge=1, le=1e6, description="MB after which a new file is begun.")
    rotate_duration: float = Field(3600.0, ge=1, le=1e6, description="Seconds until a new file is begun.")
    maps: bool = Field(True, description="Write fused maps too, not frames alone.")
    points: int = Field(
        4,
        ge=0,
        le=64,
        description="Points of each map beside it: of every so many rows and columns one; 0 = none.",
    )
    depth_mm: bool = Field(
        True, description="The depth of each map in millimetres beside it, which viewers can paint."
    )
    replays: bool = Field(False, description="Record while a recording is played, too.")
    preroll: float = Field(
        2.0,
        ge=0,
        le=60,
        description="Seconds before its start that a recording begins with; for as long nothing is lost "
        "where the disk cannot be written.",
    )
    budget: float = Field(20_000.0, ge=1, le=1e9, description="MB of all files; the oldest goes when full.")

    @model_validator(mode="after")
    def _budget_holds_a_file(self) -> Self:
        if self.budget < self.rotate_size:
            raise ValueError(
                f"budget {self.budget:g} MB must be at least rotate_size {self.rotate_size:g} MB"
            )
        return self


class OutputSection(Section):
    """What `--output` receives besides `fused.mcap`."""

    preview: bool = Field(True, description="A PNG of every map; live, of the newest, as time allows.")
    points: int = Field(
        4,
        ge=0,
        le=64,
        description="Points of each map beside it: of every so many rows and columns one; 0 = none.",
    )
    depth_mm: bool = Field(
        True, description="The depth of each map in millimetres beside it, which viewers can paint."
    )
    pictures: int = Field(1000, ge=1, le=1_000_000, description="Pictures kept live; the oldest goes.")
    rotate_size: float = Field(1024.0, ge=1, le=1e6, description="MB after which a new file is begun.")
    budget: float = Field(
        20_000.0, ge=1, le=1e9, description="MB of the files of one run; live, the oldest goes when full."
    )


class Configuration(Section):
    """Everything that can be set, by one TOML file, then the environment, then flags."""

    start: Literal["idle", "scan", "stream"] = Field("scan", description="What the service does first.")
    preset: Preset | None = Field(
        None,
        description="Settings for a purpose, under all that is set explicitly: lidarboost config presets.",
    )
    camera: CameraSection = CameraSection()
    stage: StageSection = StageSection()
    plan: PlanSection = PlanSection()
    fusion: FusionSection = FusionSection()
    stream: StreamSection = StreamSection()
    zenoh: ZenohSection = ZenohSection()
    recording: RecordingSection = RecordingSection()
    output: OutputSection = OutputSection()
    web: WebSection = WebSection()
    metrics: MetricsSection = MetricsSection()
    ros2: Ros2Section = Ros2Section()
    foxglove: FoxgloveSection = FoxgloveSection()
    log: LogSection = LogSection()
    sinks: dict[str, SinkSection] = Field({}, description="Further sinks, by the name of each.")
