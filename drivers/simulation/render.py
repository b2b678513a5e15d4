"""What a camera at a given pose receives from a scene, before any noise, and the truth behind it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.poses import camera_centre, camera_rotation
from drivers.simulation.cast import cast
from drivers.simulation.footprint import average, summed_area
from drivers.simulation.scene import Scene
from drivers.stage import Position

RAYS = 12
"""Rays per pixel side: 3 × 3 for each cell of a map fused ×4."""

MARGIN = 20
"""Pixels rendered around the view at rest: a turn of 15 px moves the corners of an SR3000's image by 19."""


@dataclass(frozen=True, eq=False)
class Truth:
    """The reference view without noise, one value per fused pixel, never an average across an edge.

    Attributes:
        distance: (βH, βW) float32 metres, the median of the cell's rays; NaN where nothing comes back.
        depth: (βH, βW) float32 metres, the same along the optical axis.
        amplitude: (βH, βW) float32, of the ray that has the median distance; 0 where nothing comes back.
    """

    distance: NDArray[np.float32]
    depth: NDArray[np.float32]
    amplitude: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class _Field:
    """The summed phasors of a flat grid of rays about one orientation, at one ambiguity range."""

    turn: NDArray[np.float64]
    ambiguity_range: float
    table: NDArray[np.float64]


class Renderer:
    """Renders a scene for a camera on its mount.

    About its own centre a camera may turn without any distance changing: the scene is cast once and every
    pose is integrated from that (see `footprint`). With a lever arm the centre moves, and each pose is cast
    anew, `RAYS` × `RAYS` rays through every pixel.

    Args:
        scene: in stage axes.
        calibration: optics without distortion, mount, and footprint without blur.
    """

    def __init__(self, scene: Scene, calibration: Calibration) -> None:
        self._surfaces = scene.packed()
        self._calibration = calibration
        self._field: _Field | None = None
        self._turns_in_place = not any(calibration.mount.lever_arm)

    def phasor(self, position: Position, ambiguity_range: float) -> NDArray[np.complex128]:
        """(H, W) mean over each pixel's footprint of strength · exp(2πi · distance / ambiguity range).

        Strength is reflectivity · cos(incidence) / distance², 1/m².
        """
        mount = self._calibration.mount
        turn = camera_rotation(position.pan, position.tilt, mount)
        centre = camera_centre(position.pan, position.tilt, mount)
        if not self._turns_in_place:
            return self._direct(turn, centre, ambiguity_range)
        if self._field is None or self._field.ambiguity_range != ambiguity_range:
            about = camera_rotation(0.0, 0.0, mount) if self._field is None else self._field.turn
            self._field = self._cast_field(about, centre, ambiguity_range)
        seen = self._integrate(self._field, turn)
        if seen is None:
            self._field = self._cast_field(turn, centre, ambiguity_range)
            seen = self._integrate(self._field, turn)
        assert seen is not None, "a view fits into the field that was cast about it"
        return seen

    def truth(self, position: Position, upsampling: int, gain: float) -> Truth:
        """The view at `position`; `gain` is amplitude per strength.

        An odd number of rays per side of a cell, so that the median is the distance of one of them.
        """
        calibration = self._calibration
        side = max(3, -(-RAYS // upsampling) // 2 * 2 + 1)
        height, width = calibration.height * upsampling, calibration.width * upsampling
        mount = calibration.mount
        distance, strength = self._cast(
            camera_rotation(position.pan, position.tilt, mount),
            camera_centre(position.pan, position.tilt, mount),
            upsampling * side,
            0,
        )
        cells = distance.reshape(height, side, width, side).swapaxes(1, 2).reshape(height, width, -1)
        middle = np.argsort(cells, axis=2, kind="stable")[:, :, side * side // 2, None]
        median = np.take_along_axis(cells, middle, axis=2)[..., 0]
        light = strength.reshape(height, side, width, side).swapaxes(1, 2).reshape(height, width, -1)
        amplitude = gain * np.take_along_axis(light, middle, axis=2)[..., 0]
        median[~np.isfinite(median)] = np.nan
        k = calibration.intrinsics
        x = ((np.arange(width) + 0.5) / upsampling - 0.5 - k.cx) / k.fx
        y = ((np.arange(height) + 0.5) / upsampling - 0.5 - k.cy) / k.fy
        depth = median / np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)
        return Truth(median.astype(np.float32), depth.astype(np.float32), amplitude.astype(np.float32))

    def _cast(
        self, turn: NDArray[np.float64], centre: NDArray[np.float64], rays: int, margin: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """`rays` per pixel side through the image and `margin` pixels around it."""
        k, (height, width) = self._calibration.intrinsics, self._calibration.shape
        first = 0.5 / rays - 0.5 - margin
        start = ((first - k.cx) / k.fx, (first - k.cy) / k.fy)
        step = (1 / (k.fx * rays), 1 / (k.fy * rays))
        shape = ((height + 2 * margin) * rays, (width + 2 * margin) * rays)
        return cast(self._surfaces, centre, turn, start, step, shape)

    def _cast_field(
        self, turn: NDArray[np.float64], centre: NDArray[np.float64], ambiguity_range: float
    ) -> _Field:
        distance, strength = self._cast(turn, centre, RAYS, MARGIN)
        return _Field(turn, ambiguity_range, summed_area(distance, strength, 2 * np.pi / ambiguity_range))

    def _integrate(self, field: _Field, turn: NDArray[np.float64]) -> NDArray[np.complex128] | None:
        K = self._calibration.intrinsics.matrix
        to_cells = np.array([[RAYS, 0, RAYS * (MARGIN + 0.5)], [0, RAYS, RAYS * (MARGIN + 0.5)], [0, 0, 1]])
        view = to_cells @ K @ field.turn.T @ turn @ np.linalg.inv(K)
        fill = self._calibration.footprint.fill_factor
        return average(field.table, view, fill, self._calibration.shape)

    def _direct(
        self, turn: NDArray[np.float64], centre: NDArray[np.float64], ambiguity_range: float
    ) -> NDArray[np.complex128]:
        height, width = self._calibration.shape
        distance, strength = self._cast(turn, centre, RAYS, 0)
        phase = np.where(strength > 0, distance, 0.0) * (2 * np.pi / ambiguity_range)
        phasors = strength * (np.cos(phase) + 1j * np.sin(phase))
        mean: NDArray[np.complex128] = phasors.reshape(height, RAYS, width, RAYS).mean(axis=(1, 3))
        return mean
