"""Parts of the view that are judged."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.errors import ConfigurationError
from service.evaluation.planes import find_planes
from service.evaluation.sight import Take

WHOLE, PLANES = "whole", "planes"


@dataclass(frozen=True, eq=False)
class Region:
    """A part of the view.

    Attributes:
        name: for people.
        mask: (H, W) in pixels of a frame.
    """

    name: str
    mask: NDArray[np.bool_]

    def at(self, factor: int) -> NDArray[np.bool_]:
        """The mask on an image `factor` times as fine."""
        return self.mask.repeat(factor, axis=0).repeat(factor, axis=1)


def regions_of(texts: Sequence[str], take: Take) -> list[Region]:
    """The regions that are named: `whole`, `planes`, or TOP,LEFT,HEIGHT,WIDTH in pixels of a frame.

    Raises:
        ConfigurationError: none of these, or a rectangle beyond the image.
    """
    found: list[Region] = []
    for text in texts:
        rectangle = parse_region(text)
        if rectangle is not None:
            found.append(_rectangle(text, rectangle, take.shape))
        elif text == PLANES:
            masks = find_planes(take.coarse.points())
            found += [Region(f"plane {number}", mask) for number, mask in enumerate(masks, start=1)]
        else:
            found.append(Region(WHOLE, np.ones(take.shape, bool)))
    return found


def parse_region(text: str) -> tuple[int, int, int, int] | None:
    """TOP, LEFT, HEIGHT, WIDTH of a rectangle; None for `whole` and `planes`; raises `ConfigurationError`."""
    if text in (WHOLE, PLANES):
        return None
    try:
        top, left, height, width = (int(part) for part in text.split(","))
    except ValueError as error:
        raise ConfigurationError(
            f"--region {text!r}: expected {WHOLE}, {PLANES}, or four whole numbers TOP,LEFT,HEIGHT,WIDTH in "
            "pixels of a frame"
        ) from error
    if top < 0 or left < 0 or height < 1 or width < 1:
        raise ConfigurationError(f"--region {text}: expected at least one pixel, within the frame")
    return top, left, height, width


def _rectangle(text: str, rectangle: tuple[int, int, int, int], shape: tuple[int, int]) -> Region:
    top, left, height, width = rectangle
    if top + height > shape[0] or left + width > shape[1]:
        raise ConfigurationError(
            f"--region {text}: reaches beyond the frame of {shape[0]} rows and {shape[1]} columns"
        )
    mask = np.zeros(shape, bool)
    mask[top : top + height, left : left + width] = True
    return Region(f"rectangle {text}", mask)
