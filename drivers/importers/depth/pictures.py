"""Depth images in picture files: PNG, TIFF, EXR and NPY."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.depth.compressed import picture
from drivers.errors import NotAvailableError, RecordingError
from drivers.importers.content import read_bounded
from drivers.importers.natural import natural

SUFFIXES = (".png", ".tif", ".tiff", ".exr", ".npy")

_LARGEST = 1 << 28
"""Bytes of a picture file."""


def is_picture(path: Path) -> bool:
    """Whether a path is a picture file, or a folder that holds some and no bag."""
    if path.is_dir():
        return any(file.suffix.lower() in SUFFIXES for file in path.iterdir())
    return path.suffix.lower() in SUFFIXES


def picture_files(paths: Sequence[Path]) -> list[Path]:
    """Files of one format, in their natural order; those of folders among them.

    Raises:
        RecordingError: several formats.
    """
    found = [
        file
        for path in paths
        for file in (path.iterdir() if path.is_dir() else [path])
        if file.suffix.lower() in SUFFIXES
    ]
    kinds = {file.suffix.lower() for file in found}
    if len(kinds) > 1:
        raise RecordingError(
            f"pictures of several formats ({', '.join(sorted(kinds))}): import each by itself"
        )
    return sorted(found, key=natural)


def read_picture(path: Path) -> NDArray[Any]:
    """(H, W) values as they are stored.

    Raises:
        RecordingError: it cannot be read, or has several channels.
        NotAvailableError: EXR without its library.
    """
    if path.suffix.lower() == ".exr":
        return _exr(path)
    if path.suffix.lower() == ".npy":
        return _npy(path)
    return picture(np.frombuffer(read_bounded(path, _LARGEST, "picture"), np.uint8), str(path))


def _npy(path: Path) -> NDArray[Any]:
    try:
        found = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise RecordingError(f"{path}: cannot be read as .npy ({' '.join(str(error).split())})") from error
    if (
        not isinstance(found, np.ndarray)
        or found.ndim != 2
        or found.dtype.kind not in "fiu"
        or 0 in found.shape
    ):
        said = f"{found.dtype} of shape {found.shape}" if isinstance(found, np.ndarray) else "an archive"
        raise RecordingError(f"{path}: holds {said}; expected a two-dimensional array of numbers")
    return np.ascontiguousarray(found.astype(found.dtype.newbyteorder("="), copy=False))


def _exr(path: Path) -> NDArray[Any]:
    try:
        import OpenEXR
    except ImportError as error:
        raise NotAvailableError(
            f"{path}: EXR is read by the library OpenEXR, which is not installed: pip install "
            "'lidarboost[import]'"
        ) from error
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.asarray(channel.pixels) for name, channel in file.channels().items()}
    except Exception as error:  # the library raises what its C++ does
        raise RecordingError(f"{path}: cannot be read as EXR ({' '.join(str(error).split())})") from error
    name = next((name for name in ("Z", "Y", "R") if name in channels), None)
    if len(channels) != 1 and name != "Z":
        raise RecordingError(
            f"{path}: has the channels {', '.join(sorted(channels))}; expected Z, or one channel alone"
        )
    return channels[name] if name is not None else next(iter(channels.values()))
