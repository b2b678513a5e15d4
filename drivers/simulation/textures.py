"""Pictures for surfaces: factors of the reflectivity, always the same for the same seed."""

import numpy as np
from numpy.typing import NDArray

SIDE = 256
"""Texels per side; over half a metre one is 2 mm, well under a fused pixel at 2 m (2.5 mm)."""

Image = NDArray[np.float32]


def grain(contrast: float, seed: int, stretch: int = 1) -> Image:
    """Smooth irregular shading, as of plaster; `stretch` times longer along u makes it wood.

    Args:
        contrast: peak deviation from 1.
        seed: of the pattern.
        stretch: a power of two up to 16.
    """
    rng = np.random.default_rng(seed)
    frequencies = np.fft.fftfreq(SIDE)[:, None] ** 2 + (np.fft.fftfreq(SIDE)[None, :] * stretch) ** 2
    # Amplitude ∝ 1/frequency: as much detail at every scale, periodic, so that it repeats without a seam.
    spectrum = np.fft.fft2(rng.standard_normal((SIDE, SIDE))) / np.sqrt(frequencies + (2 / SIDE) ** 2)
    image = np.fft.ifft2(spectrum).real
    image -= image.mean()
    shaded: Image = (1 + contrast * image / np.abs(image).max()).astype(np.float32)
    return shaded


def checks(cells: int, dark: float) -> Image:
    """A chequerboard of `cells` × `cells` fields, alternately 1 and `dark`."""
    index = np.arange(SIDE) * cells // SIDE
    return np.where((index[:, None] + index[None, :]) % 2 == 0, 1.0, dark).astype(np.float32)


def stripes(count: int, dark: float) -> Image:
    """`count` upright bars of 1 and as many of `dark`."""
    index = np.arange(SIDE) * 2 * count // SIDE
    return np.broadcast_to(np.where(index % 2 == 0, 1.0, dark), (SIDE, SIDE)).astype(np.float32)


def patches(count: int, dark: float, seed: int) -> Image:
    """`count` irregular patches (the cells of random points), their factors spread evenly from `dark` to 1 in
    logarithm; periodic."""
    rng = np.random.default_rng(seed)
    points, factors = rng.random((count, 2)) * SIDE, dark ** rng.permutation(np.linspace(0, 1, count))
    index = np.arange(SIDE) + 0.5
    away = np.full((SIDE, SIDE), np.inf)
    out = np.ones((SIDE, SIDE))
    for (row, column), factor in zip(points, factors, strict=True):
        down, right = (np.abs(index - place) for place in (row, column))
        down, right = np.minimum(down, SIDE - down), np.minimum(right, SIDE - right)
        square = down[:, None] ** 2 + right[None] ** 2
        out[square < away] = factor
        away = np.minimum(away, square)
    return out.astype(np.float32)


def text(dark: float, dot: int, seed: int) -> Image:
    """Lines of text on white: letters of 5 × 7 dots, each `dot` texels, about half of them printed."""
    rng = np.random.default_rng(seed)
    cells = SIDE // dot
    ink = rng.random((cells, cells)) < 0.5
    ink[7::9], ink[8::9], ink[:, 5::6] = False, False, False
    every = np.minimum(np.arange(SIDE) // dot, cells - 1)
    return np.where(ink[every][:, every], dark, 1.0).astype(np.float32)


def waves(height: float, seed: int, finest: float) -> Image:
    """Smooth irregular heights, metres, for a relief: a periodic random field.

    Args:
        height: its standard deviation.
        seed: of the pattern.
        finest: the deviation of the Gaussian that smooths it, in sides of the picture.
    """
    rng = np.random.default_rng(seed)
    square = np.fft.fftfreq(SIDE)[:, None] ** 2 + np.fft.fftfreq(SIDE)[None] ** 2
    spectrum = np.fft.fft2(rng.standard_normal((SIDE, SIDE)))
    image = np.fft.ifft2(spectrum * np.exp(-2 * square * (np.pi * finest * SIDE) ** 2)).real
    image -= image.mean()
    heights: Image = (height * image / image.std()).astype(np.float32)
    return heights


def label(dark: float) -> Image:
    """A parcel's printed side: a black panel with letters left white, a frame and a bar code."""
    import cv2

    ink = np.zeros((SIDE, SIDE), np.uint8)
    cv2.rectangle(ink, (14, 20), (242, 150), 255, -1)
    cv2.putText(ink, "TOF", (28, 122), cv2.FONT_HERSHEY_DUPLEX, 3.2, 0, 14)
    cv2.rectangle(ink, (14, 166), (120, 238), 255, 8)
    left = 138
    for number, width in enumerate(np.random.default_rng(5).integers(3, 11, 16)):
        if number % 2 == 0:
            cv2.rectangle(ink, (left, 168), (min(left + int(width), 242), 236), 255, -1)
        left += int(width)
    return (1 - (1 - dark) * (ink / 255.0)).astype(np.float32)
