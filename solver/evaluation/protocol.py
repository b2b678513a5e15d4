"""The paper's synthetic experiment: low-resolution, shifted, noisy frames of a known depth map.

Source: Schuon, Theobalt, Davis, Thrun, CVPR 2009, section 4: truth is the map at β times the frames'
resolution, a frame's pixel the mean over its footprint at the frame's displacement; Gaussian noise is added.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solver.errors import FusionInputError
from solver.evaluation.objects import DEPTH_RANGE

FINE = 2  # pixels of the paper's depth map per fused pixel: 400 against 200
LITERAL = (0.0, 0.7, 5.0)  # variances as the paper labels them
MATCHED = (0.0, 4.1, 46.3)  # the variances by which its first row rises
SPAN = 2.0  # pixels; frames are displaced by up to this either way


@dataclass(frozen=True, slots=True)
class Region:
    """A region of interest in low-resolution pixels; the paper crops to 106 × 64 and 126 × 89."""

    top: int
    left: int
    height: int
    width: int

    def slices(self, shape: tuple[int, int]) -> tuple[slice, slice]:
        """Rows and columns of a frame of that shape."""
        bottom, right = self.top + self.height, self.left + self.width
        inside = self.top >= 0 and self.left >= 0 and bottom <= shape[0] and right <= shape[1]
        if not inside or self.height < 1 or self.width < 1:
            raise FusionInputError(
                f"region of interest is rows {self.top} to {bottom}, columns {self.left} to {right}; the "
                f"frames have {shape[0]} × {shape[1]} pixels"
            )
        return slice(self.top, bottom), slice(self.left, right)


@dataclass(frozen=True, slots=True)
class Trial:
    """One burst with its truth.

    Attributes:
        distance: (N, H, W) float32 frames.
        shifts: (N, 2) their displacements, the first zero.
        truth: (βH, βW) float32.
    """

    distance: NDArray[np.float32]
    shifts: NDArray[np.float64]
    truth: NDArray[np.float32]


class DepthMap:
    """A depth map on 0..182 that can be averaged over any rectangle.

    Args:
        depth: (rows, columns); NaN and infinity are background.
        oversampling: pixels of `depth` per pixel of the paper's map, 1 where it has that resolution.
        rescale: bring the finite depths to 0..182, the unit of the paper's noise and λ.

    Raises:
        FusionInputError: not a two-dimensional map with at least 16 × 16 such pixels and some relief.
    """

    def __init__(self, depth: ArrayLike, *, oversampling: int = 1, rescale: bool = True) -> None:
        image = np.asarray(depth, dtype=np.float64)
        if image.ndim != 2 or min(image.shape) < 16 * oversampling:
            raise FusionInputError(
                f"the true depth map has shape {image.shape}; expected (rows, columns), at least "
                f"{16 * oversampling} × {16 * oversampling}"
            )
        known = np.isfinite(image)
        low, high = (image[known].min(), image[known].max()) if known.any() else (0.0, 0.0)
        if not high > low:
            raise FusionInputError("the true depth map is constant or empty; expected a surface with relief")
        image = np.where(known, image, high)
        self.scale = DEPTH_RANGE / (high - low) if rescale else 1.0
        self.image = (image - low) * self.scale if rescale else image
        self.oversampling = oversampling
        self._sums = np.zeros((image.shape[0] + 1, image.shape[1] + 1))
        np.cumsum(np.cumsum(self.image, axis=0), axis=1, out=self._sums[1:, 1:])

    def fused_truth(self, upsampling: int) -> NDArray[np.float32]:
        """Means over the fused pixels, (βH, βW)."""
        rows, columns = self.frame_shape(upsampling)
        side = FINE * self.oversampling
        block = self.image[: rows * upsampling * side, : columns * upsampling * side]
        shape = (rows * upsampling, side, columns * upsampling, side)
        return np.asarray(block.reshape(shape).mean(axis=(1, 3)), np.float32)

    def frame_shape(self, upsampling: int) -> tuple[int, int]:
        """Whole low-resolution pixels that fit."""
        side = upsampling * FINE * self.oversampling
        rows, columns = self.image.shape
        return rows // side, columns // side

    def frame(self, shift: ArrayLike, upsampling: int) -> NDArray[np.float32]:
        """Exact means over the pixels of a frame displaced by (dy, dx) of its pixels, edges repeated."""
        side = upsampling * FINE * self.oversampling
        dy, dx = np.asarray(shift, dtype=np.float64)
        rows, columns = self.frame_shape(upsampling)
        r = (np.arange(rows + 1) + dy) * side
        c = (np.arange(columns + 1) + dx) * side
        area = np.diff(np.diff(self._integral(r, c), axis=0), axis=1)
        return (area / side**2).astype(np.float32)

    def _integral(self, r: NDArray[np.float64], c: NDArray[np.float64]) -> NDArray[np.float64]:
        """∫∫ of the map up to rows r and columns c; beyond its edges the outermost pixels repeat."""
        along = _line(self._sums, r)
        return _line(along.T, c).T


def _line(sums: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows of cumulative sums at fractional places, extrapolated by the first and last slope."""
    last = len(sums) - 1
    below = np.clip(np.floor(at).astype(int), 0, last - 1)
    return np.asarray(sums[below] + (at - below)[:, None] * (sums[below + 1] - sums[below]))


def make_trial(
    depth: DepthMap,
    *,
    variance: float,
    seed: int,
    frames: int = 10,
    upsampling: int = 4,
    span: float = SPAN,
    region: Region | None = None,
) -> Trial:
    """A burst at random displacements with Gaussian noise of `variance`; the first frame is at rest.

    Raises:
        FusionInputError: no frame, a negative variance, or a region that leaves the frame.
    """
    if frames < 1 or variance < 0:
        raise FusionInputError(f"frames is {frames} and variance {variance:g}; expected ≥ 1 and ≥ 0")
    random = np.random.default_rng(seed)
    shifts = random.uniform(-span, span, (frames, 2))
    shifts[0] = 0
    clean = np.stack([depth.frame(shift, upsampling) for shift in shifts])
    truth = depth.fused_truth(upsampling)
    if region is not None:
        rows, columns = region.slices(depth.frame_shape(upsampling))
        clean = clean[:, rows, columns]
        fine = (slice(s.start * upsampling, s.stop * upsampling) for s in (rows, columns))
        truth = truth[tuple(fine)]
    noise = random.normal(0, np.sqrt(variance), clean.shape)
    return Trial((clean + noise).astype(np.float32), shifts, truth)
