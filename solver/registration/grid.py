"""Where a mosaic's nodes lie."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.kernels.nodes import extent

Image = NDArray[np.float32]
Place = tuple[Image, Image]
"""Rows and columns at which samples look."""

Borders = tuple[tuple[int, int], tuple[int, int]]

MARGIN = 2  # pixels around the samples, for slopes at the border
SPARE = 6  # nodes; a grid that grows often costs more than one that is somewhat larger


@dataclass(frozen=True, slots=True)
class Grid:
    """Nodes: `density` per pixel, the first one at `origin` (row, column) in pixels of the reference.

    A whole number of nodes per pixel would put all pixels of the reference, and of every shifted frame, at
    the same place between nodes, where the interpolation error has the same sign; a fraction lets it average
    out.
    """

    origin: tuple[float, float]
    size: tuple[int, int]
    density: float

    @classmethod
    def over(cls, place: Place, shape: tuple[int, int], density: float) -> "Grid":
        """The grid that holds those places (rows, columns) that are within one image of the reference."""
        first, last = extent(*place, *shape)
        low, high = np.floor(first) - MARGIN, np.ceil(last) + MARGIN
        rows, columns = np.ceil((high - low) * density).astype(int) + 1
        return cls((float(low[0]), float(low[1])), (int(rows), int(columns)), density)

    def lacking(self, place: Place, shape: tuple[int, int]) -> Borders:
        """Nodes to add before and after in rows and columns to hold other places too, with some to spare."""
        first, last = extent(*place, *shape)
        borders = []
        for start, size, low, high in zip(self.origin, self.size, first, last, strict=True):
            before = int(np.ceil((start - low + 1) * self.density))
            after = int(np.ceil((high + 1 - start) * self.density)) + 1 - size
            borders.append((before + SPARE if before > 0 else 0, after + SPARE if after > 0 else 0))
        return borders[0], borders[1]

    def extended(self, borders: Borders) -> "Grid":
        """The grid with nodes added before and after in rows and columns."""
        origin = [
            start - before / self.density for start, (before, _) in zip(self.origin, borders, strict=True)
        ]
        rows, columns = (size + sum(border) for size, border in zip(self.size, borders, strict=True))
        return Grid((origin[0], origin[1]), (rows, columns), self.density)

    def staggered(self, back: int) -> "Grid":
        """The grid whose nodes lie in the middle of this one's cells, above and left where `back` is even."""
        half = (0.5 if back % 2 else -0.5) / self.density
        return replace(self, origin=(self.origin[0] + half, self.origin[1] + half))
