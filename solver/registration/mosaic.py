"""The map that frames are registered against: all of them, fused on a grid somewhat finer than a pixel.

Each frame is a set of point samples of one continuous image, the scene blurred by the pixel's footprint. That
image is written as U, bilinear on a grid of about two nodes per pixel, and found from all samples by

    min_U  Σ_s w_s (y_s − U(p_s))²  +  λ Σ √(|∇U|² + ε²),        w = 1 / σ²

with the second term reweighted (lagged diffusivity). Every sample touches 2 × 2 nodes, so the normal
operator is a nine-point stencil, kept as five coefficient images. The footprint stays inside U: nothing is
deconvolved, and the aliasing of the single frames cancels. The edge-preserving prior matters: with a
quadratic one the noise that stays in U pulls the frames towards each other's noise.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels.edges import UNSEEN
from solver.kernels.pooling import pool_nodes
from solver.registration.grid import Grid
from solver.registration.steepness import Kind, node_kinds

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Mosaic:
    """U (C, rows, columns), each node's kind, and the variance of its slopes per pixel from noise alone.

    The kinds are `UNSEEN`, `FLAT` and `STEEP`. The misfit (rows, columns) is what its samples' variance
    really is in each cell, in σ²; None where it is one.
    """

    values: Image
    kind: Kind
    grid: Grid
    slope_noise: float
    misfit: Image | None = None


def resampled(mosaic: Mosaic, grid: Grid, factor: float) -> Image:
    """A mosaic's U at the nodes of a grid whose pixels are `factor` of the mosaic's, edges repeated."""
    scale = mosaic.grid.density * factor / grid.density
    offset = [
        ((place + 0.5) * factor - 0.5 - start) * mosaic.grid.density
        for place, start in zip(grid.origin, mosaic.grid.origin, strict=True)
    ]
    matrix = np.array([[scale, 0, offset[1]], [0, scale, offset[0]]])
    size = (grid.size[1], grid.size[0])
    flags = (cv2.INTER_LINEAR if factor != 1 else cv2.INTER_CUBIC) | cv2.WARP_INVERSE_MAP
    values = np.empty((len(mosaic.values), *grid.size), np.float32)
    for image, into in zip(mosaic.values, values, strict=True):
        cv2.warpAffine(image, matrix, size, into, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return values


def halved(mosaic: Mosaic) -> Mosaic:
    """The mosaic of the same frames pooled by two, on every second node of the grid.

    A pooled sample is the mean of four, half a pixel to both sides of its place in rows and columns.
    """
    grid = mosaic.grid
    size = (grid.size[0] + 1) // 2, (grid.size[1] + 1) // 2
    values = np.empty((len(mosaic.values), *size), np.float32)
    away = np.float32(grid.density / 2)  # nodes, at most one
    pool_nodes(mosaic.values, away, values)
    origin = (grid.origin[0] + 0.5) / 2 - 0.5, (grid.origin[1] + 0.5) / 2 - 0.5
    covered = mosaic.kind[::2, ::2] != UNSEEN
    coarse = Grid(origin, size, grid.density)
    misfit = None if mosaic.misfit is None else np.ascontiguousarray(mosaic.misfit[::2, ::2])
    return Mosaic(values, node_kinds(values, covered), coarse, mosaic.slope_noise / 4, misfit)
