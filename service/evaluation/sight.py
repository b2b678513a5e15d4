"""What is judged: images of distance with their optics, before and after fusion."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from solver.geometry.lens import pixel_rays


@dataclass(frozen=True, eq=False)
class Sight:
    """One image of distance.

    Attributes:
        distance: (H, W) radial, metres, corrected, NaN = unknown.
        intrinsics: (3, 3) camera matrix, pixels.
        distortion: OpenCV's coefficients, or None.
    """

    distance: NDArray[np.float32]
    intrinsics: NDArray[np.float64]
    distortion: tuple[float, ...] | None = None

    @property
    def rays(self) -> NDArray[np.float64]:
        """(H, W, 3) unit rays, camera axes (right, down, forward), read-only."""
        rows, columns = self.distance.shape
        return _unit_rays((rows, columns), tuple(self.intrinsics.ravel().tolist()), self.distortion)

    @property
    def known(self) -> NDArray[np.bool_]:
        """(H, W), where there is a distance."""
        return np.isfinite(self.distance)

    def points(self, mask: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """(H, W, 3) metres, NaN = unknown; or (P, 3) of the pixels of a mask."""
        if mask is None:
            return np.asarray(self.rays * self.distance[..., None].astype(np.float64))
        return np.asarray(self.rays[mask] * self.distance[mask][:, None].astype(np.float64))


@lru_cache(maxsize=4)  # all bursts have the same, at two sizes
def _unit_rays(
    shape: tuple[int, int], intrinsics: tuple[float, ...], lens: tuple[float, ...] | None
) -> NDArray[np.float64]:
    slopes = pixel_rays(shape, np.reshape(intrinsics, (3, 3)), lens)
    rays = np.concatenate([slopes[..., :2], np.ones((*shape, 1))], axis=2)
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    rays.flags.writeable = False
    return rays


@dataclass(frozen=True, eq=False)
class Take:
    """One burst.

    Attributes:
        before: its frames that look where the map does, the reference first; empty = none are known.
        after: the map.
        amplitude: (H, W) of the reference, linear, or None: boards are found in it.
        pose: pan and tilt of the reference, radians, or None = not known.
    """

    before: tuple[Sight, ...]
    after: Sight
    amplitude: NDArray[np.float32] | None = None
    pose: tuple[float, float] | None = None

    @property
    def upsampling(self) -> int:
        """β, of the map against a frame; 1 where no frame is known."""
        return self.after.distance.shape[0] // self.before[0].distance.shape[0] if self.before else 1

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a frame, in which regions are given."""
        rows, columns = self.after.distance.shape
        return rows // self.upsampling, columns // self.upsampling

    @cached_property
    def coarse(self) -> Sight:
        """The map at the size of a frame: means of β × β pixels, NaN where one is unknown."""
        factor, (rows, columns) = self.upsampling, self.shape
        blocks = self.after.distance[: rows * factor, : columns * factor]
        means = blocks.reshape(rows, factor, columns, factor).mean(axis=(1, 3))
        K = self.after.intrinsics.copy()
        K[:2, 2] = (K[:2, 2] + 0.5) / factor - 0.5
        K[0, 0] /= factor
        K[1, 1] /= factor
        return Sight(means, K, self.after.distortion)
