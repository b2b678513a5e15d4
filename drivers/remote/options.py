"""Which images are subscribed to, and how they are read."""

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from drivers.depth.reading import Kind
from drivers.device import BackendOptions

_KEY = r"^/?[^/*$#?\s]+(/[^/*$#?\s]+)*$"


class ZenohOptions(BackendOptions):
    """Whose images, where, and what they stand for."""

    source: Literal["lidarboost", "ros2", "foxglove"] = Field(
        "lidarboost",
        description="Who publishes: another rig of this program, ROS 2 nodes under rmw_zenoh, or Foxglove's "
        "protobuf messages.",
    )
    endpoint: str | None = Field(
        None, description="Where they, or a router, listen, such as tcp/192.168.1.20:7447."
    )
    config: Path | None = Field(None, description="Zenoh's own JSON5 file, instead of an endpoint.")
    prefix: str = Field("lidarboost/rig", pattern=_KEY, description="Of the other rig's keys.")
    depth: str | None = Field(
        None, pattern=_KEY, description="Depth images: topic of ROS, or key of Foxglove's messages."
    )
    amplitude: str | None = Field(
        None, pattern=_KEY, description="Amplitude images of the same times, where there are any."
    )
    camera_info: str | None = Field(
        None,
        pattern=_KEY,
        description="The optics; none = `camera_info` (ROS) or `calibration` (Foxglove) beside the depth.",
    )
    calibration: Path | None = Field(
        None, description="Calibration (TOML) instead of what is published about the optics."
    )
    domain: int = Field(0, ge=0, le=232, description="Of ROS 2.")
    kind: Kind | None = Field(
        None, description="`depth` = Z, along the optical axis; `distance` = radial; told for ROS, Foxglove."
    )
    scale: float | None = Field(
        None, ge=1e-9, le=1e3, description="Metres per unit; none = mm for integers, else metres (REP 118)."
    )
    invalid: tuple[float, ...] = Field(
        (), max_length=16, description="Values that mean no depth, besides 0, NaN and 65535."
    )
    rectified: bool | None = Field(
        None, description="Whether no distortion is left; none = where the depth's name says rect."
    )
    exposure: float = Field(
        0.05,
        gt=0,
        le=10,
        description="Seconds that an exposure takes at most, of cameras that do not say it.",
    )
    wait: float = Field(5.0, gt=0, le=600, description="Seconds to wait for the first image.")
    silence: float = Field(
        60.0, gt=0, le=86400, description="Seconds without an image after which the camera counts as lost."
    )

    @model_validator(mode="after")
    def _is_enough(self) -> Self:
        if (self.endpoint is None) == (self.config is None):
            raise ValueError("expected endpoint or config, one of them: where the images come from")
        if self.source == "lidarboost":
            return self
        if self.depth is None:
            raise ValueError(f"depth is missing: the topic or key of the depth images of {self.source}")
        if self.kind is None:
            raise ValueError("kind is missing: depth (Z, along the optical axis) or distance (radial)")
        return self
