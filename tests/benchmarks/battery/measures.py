"""What is measured of a map against the truth."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]

STEP = 0.025
"""m between neighbouring cells from which there is an edge."""

UNKNOWN = 0.5
"""m that a cell counts whose distance a map does not know."""


@dataclass(frozen=True)
class Regions:
    """Cells (βH, βW) that have a truth and were reached by a sample.

    Attributes:
        all: every one. away: over two pixels from any edge. edges: within one.
        borders: within two pixels of the image's border.
    """

    all: NDArray[np.bool_]
    away: NDArray[np.bool_]
    edges: NDArray[np.bool_]
    borders: NDArray[np.bool_]


def regions(truth: Image, positions: NDArray[np.float32], factor: int) -> Regions:
    """Regions of a truth (βH, βW) for samples at positions (N, H, W, 2)."""
    known = np.isfinite(truth) & _reached(positions, truth.shape, factor)
    filled = np.where(np.isfinite(truth), truth, -10.0).astype(np.float32)
    edge = np.zeros(truth.shape, np.uint8)
    for axis in (0, 1):
        step = np.abs(np.diff(filled, axis=axis)) > STEP
        pads = [(0, 1) if a == axis else (0, 0) for a in (0, 1)]
        edge |= np.pad(step, pads).astype(np.uint8) | np.pad(step, [p[::-1] for p in pads]).astype(np.uint8)
    away = cv2.distanceTransform(1 - edge, cv2.DIST_L2, 5) if edge.any() else np.full(truth.shape, 1e3)
    rows, columns = np.indices(truth.shape)
    inner = np.minimum(
        np.minimum(rows, truth.shape[0] - 1 - rows), np.minimum(columns, truth.shape[1] - 1 - columns)
    )
    return Regions(known, known & (away > 2 * factor), known & (away <= factor), known & (inner < 2 * factor))


def _reached(positions: NDArray[np.float32], shape: tuple[int, ...], factor: int) -> NDArray[np.bool_]:
    """Cells within the footprint of some pixel."""
    cells = np.floor((positions.reshape(-1, 2) + 0.5) * factor).astype(int)
    margin = factor
    seen = np.zeros((shape[0] + 2 * margin, shape[1] + 2 * margin), np.uint8)
    cells += margin
    inside = ((cells >= 0) & (cells < seen.shape)).all(axis=1)
    seen[tuple(cells[inside].T)] = 1
    side = factor // 2 * 2 + 1
    return cv2.dilate(seen, np.ones((side, side), np.uint8))[margin:-margin, margin:-margin] > 0


def wrong(distance: Image, truth: Image, ambiguity_range: float) -> Image:
    """Absolute errors, modulo the ambiguity range; unknown cells count `UNKNOWN`, cells without truth NaN."""
    off = distance - truth
    off = np.abs((off + ambiguity_range / 2) % ambiguity_range - ambiguity_range / 2)
    return np.where(np.isfinite(truth), np.where(np.isfinite(distance), off, UNKNOWN), np.nan)


def measure(
    distance: Image,
    deviation: Image | None,
    truth: Image,
    region: Regions,
    ambiguity_range: float,
) -> dict[str, float]:
    """Errors in mm (RMS and mean absolute) by region, shares within one and two deviations, unknown part."""
    off = wrong(distance, truth, ambiguity_range)
    found: dict[str, float] = {}
    for name in ("all", "away", "edges", "borders"):
        cells = off[getattr(region, name)].astype(np.float64)
        if cells.size:
            found[f"rms_{name}"] = 1e3 * float(np.sqrt(np.mean(cells**2)))
            found[f"mean_{name}"] = 1e3 * float(cells.mean())
    found["unknown"] = float(np.mean(~np.isfinite(distance[region.all])))
    if deviation is not None:
        for name, times in (("away", 1.0), ("edges", 2.0)):
            cells = getattr(region, name) & np.isfinite(distance)
            if cells.any():
                found[f"within_{name}"] = float(np.mean(off[cells] <= times * deviation[cells]))
    return found


def geometric(values: list[float]) -> float:
    """Geometric mean; NaN of none."""
    return float(np.exp(np.mean(np.log(values)))) if values else float("nan")
