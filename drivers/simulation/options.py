"""What a simulated camera looks at and how it is built, and what follows from that."""

from pathlib import Path
from typing import Self

from pydantic import Field, field_validator, model_validator

from drivers.calibration import Calibration, Footprint, Metres, Mount, Radians, sr3000_calibration
from drivers.device import BackendOptions
from drivers.errors import InitialisationError
from drivers.simulation.board import Chessboard, board_scene
from drivers.simulation.scene import Scene
from drivers.simulation.scenes import SCENES, build_scene, plane_scene


class CameraOptions(BackendOptions):
    """What the simulated camera looks at, and how it is built."""

    scene: str = Field("wedges", description=f"What it sees: {', '.join(SCENES)}.")
    seed: int = Field(
        0, ge=0, le=2**32 - 1, description="Of the noise: frame n of a seed is always the same."
    )
    noise: bool = Field(True, description="Whether the sensor has noise.")
    lever_arm: tuple[Metres, Metres, Metres] = Field(
        (0.0, 0.0, 0.0),
        description="Projection centre from the stage's axes, metres (x right, y down, z forward). "
        "With one every pose is rendered anew: a few frames per second instead of 50 and more.",
    )
    board: tuple[int, int] = Field((9, 6), description="Inner corners of `board`: columns, rows.")
    square: float = Field(0.05, gt=0, le=1, description="Side of a field of `board`, metres.")
    away: float | None = Field(
        None,
        ge=0.1,
        le=100,
        description="Metres to the wall of `plane` or the middle of `board`; none = 2 and 1.15.",
    )
    calibration: Path | None = Field(
        None,
        description="Calibration file of the camera that is simulated: its true optics, errors, noise and "
        "mount. None = an SR3000 whose distances err by noise alone.",
    )
    calibrated: bool = Field(
        True, description="Whether the camera knows its true calibration, else nominal optics alone."
    )
    mount_rotation: tuple[Radians, Radians, Radians] = Field(
        (0.0, 0.0, 0.0), description="Rotation vector that takes camera axes to stage axes, radians."
    )
    fill_factor: float = Field(1.0, gt=0, le=1, description="Side of a pixel's sensitive square, in pixels.")
    readout: float = Field(
        0.001, ge=0, le=0.1, description="Seconds of each frame beyond four integration times."
    )

    @field_validator("scene")
    @classmethod
    def _known(cls, name: str) -> str:
        if name not in SCENES:
            raise ValueError(f"no scene is called {name!r}; there are: {', '.join(SCENES)}")
        return name

    @model_validator(mode="after")
    def _one_truth(self) -> Self:
        given = {"lever_arm", "mount_rotation", "fill_factor"} & self.model_fields_set
        if self.calibration is not None and given:
            raise ValueError(
                f"{', '.join(sorted(given))}: the calibration file says that; give one of the two"
            )
        return self


def scene_of(options: CameraOptions) -> Scene:
    """What these options show the camera."""
    away = {} if options.away is None else {"away": options.away}
    if options.scene == "board":
        return Scene("board", board_scene(Chessboard(*options.board, options.square), **away))
    if options.scene == "plane":
        return Scene("plane", plane_scene(**away))
    return build_scene(options.scene)


def true_calibration(options: CameraOptions) -> Calibration:
    """What the camera really is; its noise law only where a file states it.

    Raises:
        RecordingError: the file is no calibration.
        InitialisationError: it is one of another size.
    """
    nominal = sr3000_calibration()
    if options.calibration is None:
        return nominal.model_copy(
            update={
                "mount": Mount(rotation=options.mount_rotation, lever_arm=options.lever_arm),
                "footprint": Footprint(fill_factor=options.fill_factor),
                "source": "simulated SR3000",
            }
        )
    known = Calibration.load(options.calibration)
    if known.shape != nominal.shape:
        raise InitialisationError(
            f"{options.calibration} is of a camera with {known.width} × {known.height} pixels; the simulated "
            f"one has {nominal.width} × {nominal.height}"
        )
    return known
