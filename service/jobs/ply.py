"""Point clouds as PLY files."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def write_ply(path: Path, points: NDArray[Any]) -> None:
    """Write points as binary little-endian PLY, every field as a 32-bit float.

    Args:
        points: (N,) structured array; its fields become the vertices' properties, by name and in order.
    """
    names = points.dtype.names or ()
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in names]
    with path.open("wb") as stream:
        stream.write("\n".join([*header, "end_header", ""]).encode("ascii"))
        stream.write(np.column_stack([points[name] for name in names]).astype("<f4").tobytes())
