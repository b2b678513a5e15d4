"""True depth maps from files."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from service.errors import ServiceError
from solver.evaluation import DepthMap, procedural_object

KEYS = ("truth", "depth", "distance")
"""Arrays of an .npz file that are taken as the map, the first that is there."""


class TruthError(ServiceError):
    """A file that holds no usable depth map."""


@dataclass(frozen=True, slots=True)
class Truth:
    """A depth map with a name, and an amplitude image of the scene where the file has one."""

    name: str
    depth: DepthMap
    amplitude: NDArray[np.float32] | None = None


def load_truth(path: Path | None) -> Truth:
    """The map of a file (npy, npz, png, mcap), or the built-in object.

    An .npz file may hold `fine`, the same map several times finer, for displacements of a fraction of a
    pixel.

    Raises:
        TruthError: not readable, or no map in it.
        FusionInputError: a map without relief or too small.
    """
    if path is None:
        return Truth("built-in object", DepthMap(procedural_object(), oversampling=2))
    readers = {".npy": _npy, ".npz": _npz, ".png": _png, ".mcap": _mcap}
    if path.suffix.lower() not in readers:
        raise TruthError(f"{path} is no depth map; expected {', '.join(readers)}")
    if not path.is_file():
        raise TruthError(f"{path} does not exist")
    return readers[path.suffix.lower()](path)


def _npy(path: Path) -> Truth:
    return Truth(path.name, DepthMap(_loaded(path, "array")))


def _npz(path: Path) -> Truth:
    arrays = _loaded(path, "archive")
    name = next((key for key in KEYS if key in arrays), None)
    if name is None:
        raise TruthError(f"{path} holds {', '.join(arrays) or 'nothing'}; expected one of {', '.join(KEYS)}")
    plain, fine = arrays[name], arrays.get("fine", arrays[name])
    if plain.ndim != 2 or not plain.size:
        raise TruthError(f"{path}: {name} has shape {plain.shape}; expected (rows, columns)")
    factor, rest = divmod(fine.shape[0], plain.shape[0])
    if rest or fine.shape != tuple(factor * size for size in plain.shape):
        raise TruthError(
            f"{path}: fine has shape {fine.shape}; expected a multiple of {name}'s, {plain.shape}"
        )
    return Truth(path.name, DepthMap(fine, oversampling=factor))


def _png(path: Path) -> Truth:
    import cv2

    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise TruthError(f"{path} is not a PNG image")
    if image.ndim != 2:
        raise TruthError(f"{path} has {image.shape[2]} channels; expected one, the depth")
    depth = image.astype(np.float64)
    depth[image == 0] = np.nan  # as in depth cameras' images, zero is no measurement
    return Truth(path.name, DepthMap(depth))


def _mcap(path: Path) -> Truth:
    from drivers.recording import Recording

    recording = Recording(path)
    truth = recording.truth
    if truth is None:
        raise TruthError(f"{path} carries no truth; simulated recordings do")
    frame = next(iter(recording.frames()), None)
    return Truth(path.name, DepthMap(truth), None if frame is None else frame.signal)


def _loaded(path: Path, kind: Literal["array", "archive"]) -> Any:
    """The file's array, or those of its arrays that can be a map, by name; float64."""
    try:
        with path.open("rb") as file:
            found = np.load(file, allow_pickle=False)
            if (kind == "array") != isinstance(found, np.ndarray):
                raise ValueError("it is of the other kind")
            if kind == "array":
                return np.asarray(found, np.float64)
            wanted = {*KEYS, "fine"}
            return {name: np.asarray(found[name], np.float64) if name in wanted else None for name in found}
    except Exception as error:  # a damaged file fails in NumPy, zipfile, zlib or for want of memory
        raise TruthError(f"{path} is not a NumPy {kind} of numbers: {error}") from error
