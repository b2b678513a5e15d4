"""What a practitioner would pick to make one depth map of many, and the settings tried for each.

Each takes the same burst with the same rotations, and gives (βH, βW) radial metres on the grid of frame 0,
NaN = unknown. The recordings' lenses have no distortion, so pinhole libraries see what we see.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from itertools import product
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
FACTOR = 4  # β


@dataclass(frozen=True)
class Views:
    """A burst.

    Attributes:
        distance: (N, H, W) radial metres.
        rotations: (N, 3, 3) from the axes of each frame to those of frame 0.
        intrinsics: (3, 3) of a frame, pixels.
    """

    distance: Image
    rotations: NDArray[np.float64]
    intrinsics: NDArray[np.float64]

    @property
    def fused_intrinsics(self) -> NDArray[np.float64]:
        """(3, 3) of the map: f' = βf, c' = β(c + ½) − ½."""
        K = self.intrinsics * FACTOR
        K[:2, 2] += (FACTOR - 1) / 2
        K[2, 2] = 1
        return K

    @property
    def fused_shape(self) -> tuple[int, int]:
        rows, columns = self.distance.shape[1:]
        return rows * FACTOR, columns * FACTOR

    @property
    def depth(self) -> Image:
        """(N, H, W) Z, metres, 0 = unknown."""
        lengths = np.linalg.norm(rays(self.intrinsics, self.distance.shape[1:]), axis=-1)
        return np.nan_to_num(self.distance / lengths).astype(np.float32)


def rays(intrinsics: NDArray[np.float64], shape: Sequence[int]) -> NDArray[np.float64]:
    """(H, W, 3) where each pixel looks; Z = 1."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    homogeneous = np.stack([columns, rows, np.ones_like(rows)], axis=-1)
    return np.asarray(homogeneous @ np.linalg.inv(intrinsics).T)


def average(views: Views, interpolation: int, middle: str) -> Image:
    """Every frame brought to the map's grid by its pose and interpolated there; mean or median of them."""
    looks = rays(views.fused_intrinsics, views.fused_shape)
    K, layers = views.intrinsics, []
    for distance, rotation in zip(views.distance, views.rotations, strict=True):
        seen = looks @ rotation  # R⁻¹ x, in rows
        x = (K[0, 0] * seen[..., 0] / seen[..., 2] + K[0, 2]).astype(np.float32)
        y = (K[1, 1] * seen[..., 1] / seen[..., 2] + K[1, 2]).astype(np.float32)
        layers.append(
            cv2.remap(
                distance, x, y, interpolation, borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan,) * 4
            )
        )
    stacked = np.stack(layers)
    return np.asarray((np.nanmedian if middle == "median" else np.nanmean)(stacked, axis=0), np.float32)


def open3d_tsdf(views: Views, voxel: float, truncation: float) -> Image:
    """Open3D's TSDF, a `VoxelBlockGrid`; its mesh seen from frame 0."""
    import open3d as o3d

    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    grid = o3d.t.geometry.VoxelBlockGrid(
        attr_names=("tsdf", "weight"),
        attr_dtypes=(o3d.core.float32, o3d.core.float32),
        attr_channels=((1,), (1,)),
        voxel_size=voxel,
        block_resolution=8,
        block_count=20_000,  # it grows
    )
    camera = o3d.core.Tensor(views.intrinsics)
    for depth, rotation in zip(views.depth, views.rotations, strict=True):
        image = o3d.t.geometry.Image(o3d.core.Tensor(np.ascontiguousarray(depth)))
        extrinsic = np.eye(4)
        extrinsic[:3, :3] = rotation.T  # from the axes of frame 0 to those of this frame
        place = camera, o3d.core.Tensor(extrinsic), 1.0, 20.0, truncation
        grid.integrate(grid.compute_unique_block_coordinates(image, *place), image, *place)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(grid.extract_triangle_mesh(weight_threshold=0.0))
    looks = rays(views.fused_intrinsics, views.fused_shape)
    looks /= np.linalg.norm(looks, axis=-1, keepdims=True)
    beams = np.concatenate([np.zeros_like(looks), looks], axis=-1).astype(np.float32)
    found = scene.cast_rays(o3d.core.Tensor(beams))["t_hit"].numpy()
    return np.where(np.isfinite(found), found, np.nan).astype(np.float32)


def opencv_volume(views: Views, voxel: float, truncation: float) -> Image:
    """OpenCV's `Volume` (hashed TSDF), raycast from frame 0."""
    settings = cv2.VolumeSettings(cv2.VolumeType_HashTSDF)
    rows, columns = views.distance.shape[1:]
    height, width = views.fused_shape
    settings.setVoxelSize(voxel)
    settings.setTsdfTruncateDistance(truncation * voxel)
    settings.setDepthFactor(1.0)
    settings.setMaxDepth(20.0)
    settings.setMaxWeight(len(views.distance))
    settings.setIntegrateWidth(columns)
    settings.setIntegrateHeight(rows)
    settings.setRaycastWidth(width)
    settings.setRaycastHeight(height)
    settings.setCameraIntegrateIntrinsics(views.intrinsics.astype(np.float32))
    settings.setCameraRaycastIntrinsics(views.fused_intrinsics.astype(np.float32))
    settings.setVolumePose(np.eye(4, dtype=np.float32))
    volume = cv2.Volume(cv2.VolumeType_HashTSDF, settings)
    for depth, rotation in zip(views.depth, views.rotations, strict=True):
        pose = np.eye(4, dtype=np.float32)
        pose[:3, :3] = rotation
        volume.integrate(np.ascontiguousarray(depth), pose)
    points, _ = volume.raycast(np.eye(4, dtype=np.float32))
    return np.linalg.norm(points[..., :3], axis=-1).astype(np.float32)


def average_tgv(views: Views, strength: float, interpolation: int, iterations: int = 200) -> Image:
    """The median, denoised by second-order total generalized variation (Bredies 2010), α₀ = 2 α₁.

    min ½‖u − f‖² + α₁‖∇u − w‖ + α₀‖ℰw‖, by PyLops' operators and PyProximal's primal-dual algorithm.
    """
    import pylops
    import pyproximal

    mean = average(views, interpolation, "median")
    known = np.where(np.isfinite(mean), mean, np.float32(np.nanmedian(mean)))
    shape, size = known.shape, known.size
    gradient = pylops.Gradient(shape, kind="forward", edge=False, dtype="float64")
    down = pylops.FirstDerivative(shape, axis=0, kind="backward", dtype="float64")
    right = pylops.FirstDerivative(shape, axis=1, kind="backward", dtype="float64")
    half = np.sqrt(0.5)  # ℰ's mixed term counts twice in its norm
    symmetric = pylops.Block(
        [[down, pylops.Zero(size)], [pylops.Zero(size), right], [half * right, half * down]]
    )
    operator = pylops.Block(
        [[gradient, -1.0 * pylops.Identity(2 * size)], [pylops.Zero(3 * size, size), symmetric]]
    )
    data = pyproximal.VStack(
        [pyproximal.L2(b=known.ravel().astype(float)), pyproximal.L2(sigma=0.0)], [size, 2 * size]
    )
    penalty = pyproximal.VStack(
        [pyproximal.L21(ndim=2, sigma=strength), pyproximal.L21(ndim=3, sigma=2 * strength)],
        [2 * size, 3 * size],
    )
    step = 0.95 / np.sqrt(12.0)  # ‖K‖² ≤ 12
    start = np.concatenate([known.ravel(), np.zeros(2 * size)])
    found = pyproximal.optimization.primaldual.PrimalDual(
        data, penalty, operator, x0=start, tau=step, mu=step, theta=1.0, niter=iterations
    )
    return np.asarray(found[:size].reshape(shape), np.float32)


@dataclass(frozen=True)
class Peer:
    """A method of others.

    Attributes:
        name: in the table.
        fuse: views and settings in, a map out.
        settings: values that are tried of each; every combination is judged against the truth.
        needs: libraries that `pip install` names, by the module that is looked for.
    """

    name: str
    fuse: Callable[..., Image]
    settings: Mapping[str, Sequence[Any]]
    needs: Mapping[str, str] = field(default_factory=dict)

    def choices(self) -> list[dict[str, Any]]:
        """Every combination of settings."""
        return [dict(zip(self.settings, values, strict=True)) for values in product(*self.settings.values())]

    @property
    def missing(self) -> str | None:
        """The line that installs what it lacks; None where nothing is."""
        lacking = any(find_spec(module) is None for module in self.needs)
        if "cv2" in self.needs and not hasattr(cv2, "Volume"):
            lacking = True
        return f"pip install {' '.join(self.needs.values())}" if lacking else None


PEERS = (
    Peer(
        "average",
        average,
        {
            "interpolation": (cv2.INTER_NEAREST, cv2.INTER_LINEAR, cv2.INTER_CUBIC),
            "middle": ("mean", "median"),
        },
    ),
    Peer(
        "Open3D TSDF",
        open3d_tsdf,
        {"voxel": (0.008, 0.016, 0.032, 0.064), "truncation": (6.0, 12.0, 24.0, 48.0)},
        {"open3d": "'open3d>=0.20'"},
    ),
    Peer(
        "OpenCV Volume",
        opencv_volume,
        {"voxel": (0.003, 0.004, 0.008), "truncation": (3.0, 6.0, 12.0)},
        {"cv2": "'opencv-python-headless>=5'"},
    ),
    Peer(
        "average + TGV",
        average_tgv,
        {"strength": (0.01, 0.03, 0.1), "interpolation": (cv2.INTER_NEAREST, cv2.INTER_LINEAR)},
        {"pylops": "'pylops>=2.8'", "pyproximal": "'pyproximal>=0.13'"},
    ),
)
