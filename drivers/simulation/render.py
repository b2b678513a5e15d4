"""What a camera at a given pose receives from a scene, before any noise, and the truth behind it."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration
from drivers.lens import straightened
from drivers.poses import camera_centre, camera_rotation
from drivers.position import Position
from drivers.simulation.cast import cast
from drivers.simulation.footprint import average, average_at, fits, fits_at, summed_area
from drivers.simulation.lens import footprint_places
from drivers.simulation.scene import Scene

RAYS = 12
"""Rays per pixel side: 3 × 3 for each cell of a map fused ×4."""

WORKERS = 2
"""Threads; the kernels let go of the interpreter."""

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
    tables: NDArray[np.float64]


class _Look(NamedTuple):
    """One image to be had: where from, and which part of the phasor (0 real, 1 imaginary)."""

    position: Position
    ambiguity_range: float
    part: int


class Renderer:
    """Renders a scene for a camera on its mount.

    About its own centre a camera may turn without any distance changing: the scene is cast once and every
    pose is integrated from that (see `footprint`). With a lever arm the centre moves, and each pose is cast
    anew, `RAYS` × `RAYS` rays through every pixel. Rays are always cast as of a lens without distortion; with
    one, pixels integrate where they look in that image.

    Args:
        scene: in stage axes.
        calibration: optics, mount, and footprint (its fill factor; no blur).
    """

    def __init__(self, scene: Scene, calibration: Calibration) -> None:
        self._surfaces = scene.packed()
        self._calibration = calibration
        self._field: _Field | None = None
        self._turns_in_place = not any(calibration.mount.lever_arm)
        self._places = footprint_places(calibration) if any(calibration.distortion) else None
        self._margin = MARGIN if self._places is None else MARGIN + _overshoot(self._places)
        self._seen: dict[_Look, NDArray[np.float64]] = {}

    def correlations(self, positions: Sequence[Position], ambiguity_range: float) -> NDArray[np.float64]:
        """(4, H, W): Re P, Im P, Re P, Im P of what each pixel receives at the pose of each phase sample.

        P is the mean over the pixel's footprint of strength · exp(2πi · distance / ambiguity range), strength
        being reflectivity · cos(incidence) / distance², 1/m².
        """
        looks = [_Look(place, ambiguity_range, k % 2) for k, place in enumerate(positions)]
        new = list(dict.fromkeys(look for look in looks if look not in self._seen))
        found = self._integrated(new) if self._turns_in_place else self._cast_anew(new)
        self._seen = {look: found[look] if look in found else self._seen[look] for look in looks}
        return np.stack([self._seen[look] for look in looks])

    def truth(self, position: Position, upsampling: int, gain: float) -> Truth:
        """The view at `position`; `gain` is amplitude per strength.

        An odd number of rays per side of a cell, so that the median is the distance of one of them.
        """
        calibration = self._calibration
        side = max(3, -(-RAYS // upsampling) // 2 * 2 + 1)
        height, width = calibration.height * upsampling, calibration.width * upsampling
        distance, strength = self._cast_view(position, upsampling * side)
        cells = distance.reshape(height, side, width, side).swapaxes(1, 2).reshape(height, width, -1)
        middle = np.argsort(cells, axis=2, kind="stable")[:, :, side * side // 2, None]
        median = np.take_along_axis(cells, middle, axis=2)[..., 0]
        light = strength.reshape(height, side, width, side).swapaxes(1, 2).reshape(height, width, -1)
        amplitude = gain * np.take_along_axis(light, middle, axis=2)[..., 0]
        median[~np.isfinite(median)] = np.nan
        k = calibration.intrinsics
        centres = straightened(_lattice(height, width, upsampling), calibration)
        x, y = (centres[..., 0] - k.cx) / k.fx, (centres[..., 1] - k.cy) / k.fy
        depth = median / np.sqrt(1 + x**2 + y**2)
        return Truth(median.astype(np.float32), depth.astype(np.float32), amplitude.astype(np.float32))

    def _cast_view(self, position: Position, rays: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """`rays` per pixel side through the image as it is, distorted where the lens does that."""
        mount = self._calibration.mount
        turn = camera_rotation(position.pan, position.tilt, mount)
        centre = camera_centre(position.pan, position.tilt, mount)
        if self._places is None:
            return self._cast(turn, centre, rays, 0)
        distance, strength = self._cast(turn, centre, rays, self._margin)
        height, width = self._calibration.shape
        looks = straightened(_lattice(height * rays, width * rays, rays), self._calibration)
        nearest = np.rint((looks + 0.5 + self._margin) * rays - 0.5).astype(np.int64)
        return distance[nearest[..., 1], nearest[..., 0]], strength[nearest[..., 1], nearest[..., 0]]

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

    def _integrated(self, looks: Sequence[_Look]) -> dict[_Look, NDArray[np.float64]]:
        with ThreadPoolExecutor(WORKERS) as pool:
            jobs = {}
            for look in looks:
                field, view = self._field_for(look)
                jobs[look] = pool.submit(self._integrate, field.tables[look.part], view)
            return {look: job.result() for look, job in jobs.items()}

    def _field_for(self, look: _Look) -> tuple[_Field, NDArray[np.float64]]:
        """A field that holds the whole view, and the view of it: the last one, or one cast about the pose."""
        mount = self._calibration.mount
        turn = camera_rotation(look.position.pan, look.position.tilt, mount)
        field = self._field
        if field is None or field.ambiguity_range != look.ambiguity_range:
            about = camera_rotation(0.0, 0.0, mount) if field is None else field.turn
            field = self._cast_field(about, look.ambiguity_range)
        if not self._holds(field, turn):
            field = self._cast_field(turn, look.ambiguity_range)
        self._field = field
        return field, self._view(field, turn)

    def _integrate(self, table: NDArray[np.float64], view: NDArray[np.float64]) -> NDArray[np.float64]:
        out = np.empty(self._calibration.shape)
        if self._places is None:
            average(table, view, self._calibration.footprint.fill_factor, out)
        else:
            average_at(table, view, self._places, out)
        return out

    def _holds(self, field: _Field, turn: NDArray[np.float64]) -> bool:
        """Whether the view of a camera turned by `turn` lies within the field."""
        table, view = field.tables[0], self._view(field, turn)
        if self._places is None:
            return fits(table, view, self._calibration.shape)
        return fits_at(table, view, _border(self._places))

    def _cast_field(
        self, turn: NDArray[np.float64], ambiguity_range: float, centre: NDArray[np.float64] | None = None
    ) -> _Field:
        distance, strength = self._cast(turn, np.zeros(3) if centre is None else centre, RAYS, self._margin)
        return _Field(turn, ambiguity_range, summed_area(distance, strength, 2 * np.pi / ambiguity_range))

    def _view(self, field: _Field, turn: NDArray[np.float64]) -> NDArray[np.float64]:
        """(3, 3) homography from pixels of a camera turned by `turn` to corners of the field's cells."""
        K = self._calibration.intrinsics.matrix
        edge = RAYS * (self._margin + 0.5)
        to_cells = np.array([[RAYS, 0.0, edge], [0.0, RAYS, edge], [0.0, 0.0, 1.0]])
        view: NDArray[np.float64] = to_cells @ K @ field.turn.T @ turn @ np.linalg.inv(K)
        return view

    def _cast_anew(self, looks: Sequence[_Look]) -> dict[_Look, NDArray[np.float64]]:
        at = {place: self._direct(place, span) for place, span in {look[:2] for look in looks}}
        return {look: at[look.position].imag if look.part else at[look.position].real for look in looks}

    def _direct(self, position: Position, ambiguity_range: float) -> NDArray[np.complex128]:
        height, width = self._calibration.shape
        mount = self._calibration.mount
        turn = camera_rotation(position.pan, position.tilt, mount)
        centre = camera_centre(position.pan, position.tilt, mount)
        if self._places is not None:
            field = self._cast_field(turn, ambiguity_range, centre)
            view = self._view(field, turn)
            real, imaginary = (self._integrate(table, view) for table in field.tables)
            return real + 1j * imaginary
        distance, strength = self._cast(turn, centre, RAYS, 0)
        phase = np.where(strength > 0, distance, 0.0) * (2 * np.pi / ambiguity_range)
        waves = (strength * np.exp(1j * phase)).reshape(height, RAYS, width, RAYS)
        share = self._ray_shares()
        mean: NDArray[np.complex128] = share @ waves.swapaxes(1, 2) @ share
        return mean

    def _ray_shares(self) -> NDArray[np.float64]:
        """(RAYS,) how much of a pixel's sensitive side lies in the cell of each ray; the sum is 1."""
        fill = self._calibration.footprint.fill_factor
        edges = np.clip(np.linspace(-0.5, 0.5, RAYS + 1), -fill / 2, fill / 2)
        shares: NDArray[np.float64] = np.diff(edges) / fill
        return shares


def _lattice(rows: int, columns: int, per_pixel: int) -> NDArray[np.float64]:
    """(rows, columns, 2): column and row in pixels of the middles of cells, `per_pixel` to a pixel's side."""
    y, x = ((np.arange(n) + 0.5) / per_pixel - 0.5 for n in (rows, columns))
    return np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=-1)


def _border(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """(M, 2) the places of the outermost pixels."""
    sides = places[0], places[-1], places[:, 0], places[:, -1]
    return np.concatenate([side.reshape(-1, 2) for side in sides])


def _overshoot(places: NDArray[np.float64]) -> int:
    """Whole pixels by which a distorting lens sees more than the image without distortion holds."""
    border, (height, width) = _border(places), places.shape[:2]
    beyond = np.maximum(-0.5 - border, border - [width - 0.5, height - 0.5]).max()
    return max(0, int(np.ceil(beyond)) + 1)
