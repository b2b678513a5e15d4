"""Maps within the border that the kernels of the iteration need."""

import numpy as np
from numpy.typing import NDArray

from solver.kernels.group import PAD

Image = NDArray[np.floating]


def padded(image: Image) -> Image:
    """(C, rows + 4, columns + 4): the image (C, rows, columns) within `PAD` zeros on every side."""
    channels, rows, columns = image.shape
    # np.pad takes longer than a small image's kernels.
    out = np.zeros((channels, rows + 2 * PAD, columns + 2 * PAD), image.dtype)
    out[:, PAD:-PAD, PAD:-PAD] = image
    return out


def cropped(image: Image, shape: tuple[int, int]) -> Image:
    """(C, rows, columns): a larger image's middle, with as much left out on either side."""
    return image[:, *(slice((n - m) // 2, (n + m) // 2) for n, m in zip(image.shape[1:], shape, strict=True))]
