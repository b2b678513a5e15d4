"""Surfaces with reflectivity, in stage axes (x right, y down, z forward), metres.

Every surface is matt (Lambertian), seen from both sides, and may have a lattice of holes and a texture; a
plate may have a relief.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

PLATE, DISC, SPHERE, FRUSTUM = range(4)
ROUND, RECTANGULAR = 1, 2


class Packed(NamedTuple):
    """All surfaces as arrays with one row each, as the ray caster reads them.

    `size` is (lower half width, upper half width, half height, lean) of a plate, (radius, –, –, –) of a disc
    or sphere, (lower radius, upper radius, half height, –) of a frustum. The lean of a plate is how far the
    middle of its upper edge lies to the right of the middle of its lower one. `radius` bounds the surface;
    `texture` counts in `textures`, −1 = none; `hole` is 0 = none, `ROUND` or `RECTANGULAR`; `relief` counts
    in `heights`, −1 = none.
    """

    kind: NDArray[np.int64]
    centre: NDArray[np.float64]
    axes: NDArray[np.float64]
    size: NDArray[np.float64]
    radius: NDArray[np.float64]
    reflectivity: NDArray[np.float64]
    texture: NDArray[np.int64]
    period: NDArray[np.float64]
    hole: NDArray[np.int64]
    pitch: NDArray[np.float64]
    opening: NDArray[np.float64]
    extent: NDArray[np.float64]
    textures: NDArray[np.float32]
    relief: NDArray[np.int64]
    heights: NDArray[np.float32]


@dataclass(frozen=True)
class Holes:
    """A lattice of openings in the surface's own coordinates (u right, v up, metres from its centre).

    Attributes:
        pitch: distance between centres along u and v.
        opening: half width along u and half height along v; equal for round ones.
        extent: only lattice cells whose centre lies within ± extent of the surface's centre are open.
        round: ellipses, else rectangles.
    """

    pitch: tuple[float, float]
    opening: tuple[float, float]
    extent: tuple[float, float]
    round: bool = True


@dataclass(frozen=True)
class Texture:
    """A picture that multiplies the reflectivity, repeated every `period` (u, v) metres.

    Attributes:
        image: (S, S) float32 factors, row 0 on top; every texture of a scene has the same size.
        period: metres along u and v.
    """

    image: NDArray[np.float32]
    period: tuple[float, float]


@dataclass(frozen=True)
class Relief:
    """Heights over a plate, along its normal; the picture covers the plate once.

    Attributes:
        heights: (S, S) float32 metres, row 0 on top; every relief of a scene has the same size. They are
            found along a ray by a fixed point, so slopes have to stay well below 1.
    """

    heights: NDArray[np.float32]


@dataclass(frozen=True)
class Surface:
    """One surface; make it with `plate`, `triangle`, `disc`, `sphere` or `frustum`."""

    kind: int
    centre: NDArray[np.float64]
    size: tuple[float, float, float, float]
    reflectivity: float
    axes: NDArray[np.float64] = field(default_factory=lambda: facing((0.0, 0.0, -1.0)))
    holes: Holes | None = None
    texture: Texture | None = None
    relief: Relief | None = None

    def turned(self, rotation: NDArray[np.float64], about: ArrayLike) -> Self:
        """The surface turned by a (3, 3) rotation about a point."""
        pivot = np.asarray(about, dtype=np.float64)
        return replace(self, centre=pivot + rotation @ (self.centre - pivot), axes=self.axes @ rotation.T)

    @property
    def radius(self) -> float:
        """Of the smallest known sphere about the centre that holds it."""
        first, second, half, lean = self.size
        if self.kind in (DISC, SPHERE):
            return first
        flat = float(np.hypot(max(first, second) + abs(lean) / 2, half))
        return flat if self.relief is None else flat + float(np.abs(self.relief.heights).max())


def facing(normal: ArrayLike, up: ArrayLike = (0.0, -1.0, 0.0)) -> NDArray[np.float64]:
    """(3, 3) axes with rows u (right, as seen from where the normal points), v (up) and the normal."""
    n = np.asarray(normal, dtype=np.float64) / np.linalg.norm(normal)
    u = np.cross(np.asarray(up, dtype=np.float64), n)
    if np.linalg.norm(u) < 1e-9:
        u = np.cross((0.0, 0.0, 1.0), n)
    u /= np.linalg.norm(u)
    return np.stack([u, np.cross(n, u), n])


def plate(
    centre: ArrayLike,
    width: float | tuple[float, float],
    height: float,
    reflectivity: float,
    *,
    normal: ArrayLike = (0.0, 0.0, -1.0),
    up: ArrayLike = (0.0, -1.0, 0.0),
    holes: Holes | None = None,
    texture: Texture | None = None,
    relief: Relief | None = None,
) -> Surface:
    """A flat trapezium: `width` at the bottom and at the top where two are given (0 on top = a triangle)."""
    bottom, top = width if isinstance(width, tuple) else (width, width)
    size = (bottom / 2, top / 2, height / 2, 0.0)
    return Surface(PLATE, _point(centre), size, reflectivity, facing(normal, up), holes, texture, relief)


def triangle(
    left: ArrayLike, right: ArrayLike, tip: ArrayLike, reflectivity: float, *, texture: Texture | None = None
) -> Surface:
    """Any triangle: its lower edge runs from `left` to `right`, `tip` is the third corner."""
    a, b, c = _point(left), _point(right), _point(tip)
    width = float(np.linalg.norm(b - a))
    u = (b - a) / width
    middle = (a + b) / 2
    lean = float((c - middle) @ u)
    rise = c - middle - lean * u
    height = float(np.linalg.norm(rise))
    axes = np.stack([u, rise / height, np.cross(u, rise / height)])
    size = (width / 2, 0.0, height / 2, lean)
    return Surface(PLATE, (middle + c) / 2, size, reflectivity, axes, texture=texture)


def disc(
    centre: ArrayLike,
    radius: float,
    reflectivity: float,
    *,
    normal: ArrayLike = (0.0, 0.0, -1.0),
    holes: Holes | None = None,
    texture: Texture | None = None,
) -> Surface:
    """A flat round."""
    return Surface(
        DISC, _point(centre), (radius, 0.0, 0.0, 0.0), reflectivity, facing(normal), holes, texture
    )


def sphere(
    centre: ArrayLike, radius: float, reflectivity: float, *, texture: Texture | None = None
) -> Surface:
    """A ball; u is longitude times radius, v latitude times radius."""
    return Surface(SPHERE, _point(centre), (radius, 0.0, 0.0, 0.0), reflectivity, texture=texture)


def frustum(
    centre: ArrayLike,
    radii: tuple[float, float],
    height: float,
    reflectivity: float,
    *,
    axis: ArrayLike = (0.0, -1.0, 0.0),
    holes: Holes | None = None,
    texture: Texture | None = None,
) -> Surface:
    """The side of a cone cut off (a cylinder where both radii are equal), open at both ends.

    `radii` are the one at the start and the one at the end of the axis; u runs around, at the mean radius,
    v along the axis.
    """
    size = (radii[0], radii[1], height / 2, 0.0)
    return Surface(FRUSTUM, _point(centre), size, reflectivity, facing(axis, (0, 0, 1)), holes, texture)


@dataclass(frozen=True)
class Scene:
    """What the camera looks at.

    Attributes:
        name: what it is called on the command line.
        surfaces: in any order.
    """

    name: str
    surfaces: Sequence[Surface]

    def packed(self) -> Packed:
        """The surfaces as arrays."""
        every = list(self.surfaces)
        drawn = [s.texture for s in every if s.texture is not None]
        images = list({id(texture.image): texture.image for texture in drawn}.values())
        number = {id(image): index for index, image in enumerate(images)}
        raised = [s.relief.heights for s in every if s.relief is not None]
        order = np.cumsum([s.relief is not None for s in every]) - 1
        holes = [s.holes if s.holes is not None else _NO_HOLES for s in every]
        shapes = [0 if s.holes is None else ROUND if s.holes.round else RECTANGULAR for s in every]
        return Packed(
            kind=np.array([s.kind for s in every], np.int64),
            centre=np.array([s.centre for s in every]),
            axes=np.array([s.axes for s in every]),
            size=np.array([s.size for s in every]),
            radius=np.array([s.radius for s in every]),
            reflectivity=np.array([s.reflectivity for s in every]),
            texture=np.array(
                [-1 if s.texture is None else number[id(s.texture.image)] for s in every], np.int64
            ),
            period=np.array([(1.0, 1.0) if s.texture is None else s.texture.period for s in every]),
            hole=np.array(shapes, np.int64),
            pitch=np.array([h.pitch for h in holes]),
            opening=np.array([h.opening for h in holes]),
            extent=np.array([h.extent for h in holes]),
            textures=np.stack(images).astype(np.float32) if images else np.ones((1, 2, 2), np.float32),
            relief=np.array([-1 if s.relief is None else order[k] for k, s in enumerate(every)], np.int64),
            heights=np.stack(raised).astype(np.float32) if raised else np.zeros((1, 2, 2), np.float32),
        )


_NO_HOLES = Holes((1.0, 1.0), (0.0, 0.0), (0.0, 0.0))


def _point(values: ArrayLike) -> NDArray[np.float64]:
    point = np.asarray(values, dtype=np.float64)
    if point.shape != (3,):
        raise ValueError(f"a point needs x, y, z; got shape {point.shape}")
    return point
