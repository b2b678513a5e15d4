"""Rays against surfaces, compiled: what each ray of a flat grid hits first, and how much light comes back."""

from itertools import pairwise

import numba
import numpy as np
from numpy.typing import NDArray

from drivers.simulation.scene import DISC, FRUSTUM, ROUND, SPHERE, Packed

TILE = 48
"""Rays per side of a tile that shares one list of surfaces in sight; 4 × 4 pixels of 12 × 12 rays."""

NEAREST = 1e-6
"""Hits nearer than this along a ray (in units of its z = 1 vector) are behind the camera or at it."""

CLIMBS = 12
"""Rounds of the fixed point on a relief; each takes off all but slope · tan(incidence) of what is left."""

_jit = numba.njit(cache=True, nogil=True, error_model="numpy")
_inlined = numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
"""For what is called for each ray: a function that takes an array counts a reference to it at every call."""


@_inlined
def _is_open(k: int, hole, pitch, opening, extent, u: float, v: float) -> bool:  # type: ignore[no-untyped-def]
    if hole[k] == 0:
        return False
    cell_u = np.floor(u / pitch[k, 0] + 0.5) * pitch[k, 0]
    cell_v = np.floor(v / pitch[k, 1] + 0.5) * pitch[k, 1]
    if abs(cell_u) > extent[k, 0] or abs(cell_v) > extent[k, 1]:
        return False
    du, dv = (u - cell_u) / opening[k, 0], (v - cell_v) / opening[k, 1]
    if hole[k] == ROUND:
        return bool(du * du + dv * dv < 1.0)
    return bool(abs(du) < 1.0 and abs(dv) < 1.0)


@_inlined
def _reflectivity(s: Packed, k: int, u: float, v: float) -> float:
    """Reflectivity at (u, v), the texture interpolated bilinearly and repeated."""
    if s.texture[k] < 0:
        return float(s.reflectivity[k])
    image = s.textures[s.texture[k]]
    return float(s.reflectivity[k] * _at(image, u / s.period[k, 0], v / s.period[k, 1]))


@_inlined
def _at(image, u: float, v: float) -> float:  # type: ignore[no-untyped-def]
    """A square picture that spans −½ to ½, interpolated bilinearly and repeated; v up."""
    side = image.shape[0]
    x, y = (u + 0.5) * side - 0.5, (0.5 - v) * side - 0.5
    column, row = int(np.floor(x)), int(np.floor(y))
    fx, fy = x - column, y - row
    c0, c1, r0, r1 = column % side, (column + 1) % side, row % side, (row + 1) % side
    top = image[r0, c0] * (1 - fx) + image[r0, c1] * fx
    bottom = image[r1, c0] * (1 - fx) + image[r1, c1] * fx
    return float(top * (1 - fy) + bottom * fy)


@_inlined
def _climb(k: int, size, relief, heights, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Where a ray meets a plate's relief: (t, cosine to the normal); the plane's own where there is none."""
    t = -oz / dz
    if relief[k] < 0:
        return t, abs(dz)
    image, width, height = heights[relief[k]], 2 * size[k, 0], 2 * size[k, 2]
    for _ in range(CLIMBS):
        t = (_at(image, (ox + t * dx) / width, (oy + t * dy) / height) - oz) / dz
    u, v, step = (ox + t * dx) / width, (oy + t * dy) / height, 0.5 / image.shape[0]
    across = (_at(image, u + step, v) - _at(image, u - step, v)) / (2 * step * width)
    along = (_at(image, u, v + step) - _at(image, u, v - step)) / (2 * step * height)
    return t, abs(dz - across * dx - along * dy) / np.sqrt(1 + across * across + along * along)


@_inlined
def _hit_flat(  # type: ignore[no-untyped-def]
    k: int, kind, size, relief, heights, hole, pitch, opening, extent, ox, oy, oz, dx, dy, dz
):
    t, cosine = _climb(k, size, relief, heights, ox, oy, oz, dx, dy, dz)
    if not t > NEAREST:
        return np.inf, 0.0, 0.0, 0.0
    u, v = ox + t * dx, oy + t * dy
    first, half = size[k, 0], size[k, 2]
    if kind[k] == DISC:
        if u * u + v * v > first * first:
            return np.inf, 0.0, 0.0, 0.0
    else:
        if abs(v) > half:
            return np.inf, 0.0, 0.0, 0.0
        height = (v + half) / (2 * half)
        if abs(u - size[k, 3] * (height - 0.5)) > first + (size[k, 1] - first) * height:
            return np.inf, 0.0, 0.0, 0.0
    if _is_open(k, hole, pitch, opening, extent, u, v):
        return np.inf, 0.0, 0.0, 0.0
    return t, u, v, cosine


@_inlined
def _hit_sphere(k: int, size, ox, oy, oz, dx, dy, dz):  # type: ignore[no-untyped-def]
    radius = size[k, 0]
    a = dx * dx + dy * dy + dz * dz
    b = ox * dx + oy * dy + oz * dz
    root = b * b - a * (ox * ox + oy * oy + oz * oz - radius * radius)
    if root <= 0.0:
        return np.inf, 0.0, 0.0, 0.0
    root = np.sqrt(root)
    t = (-b - root) / a
    if t < NEAREST:
        t = (-b + root) / a
    if t < NEAREST:
        return np.inf, 0.0, 0.0, 0.0
    x, y, z = (ox + t * dx) / radius, (oy + t * dy) / radius, (oz + t * dz) / radius
    u, v = radius * np.arctan2(x, z), radius * np.arcsin(min(1.0, max(-1.0, y)))
    return t, u, v, abs(x * dx + y * dy + z * dz)


@_inlined
def _hit_frustum(  # type: ignore[no-untyped-def]
    k: int, size, hole, pitch, opening, extent, ox, oy, oz, dx, dy, dz
):
    half = size[k, 2]
    mean, slope = 0.5 * (size[k, 0] + size[k, 1]), (size[k, 1] - size[k, 0]) / (2 * half)
    r = mean + slope * oz
    a = dx * dx + dy * dy - slope * slope * dz * dz
    b = ox * dx + oy * dy - slope * r * dz
    root = b * b - a * (ox * ox + oy * oy - r * r)
    if root <= 0.0 or a == 0.0:
        return np.inf, 0.0, 0.0, 0.0
    root = np.sqrt(root)
    first, second = (-b - root) / a, (-b + root) / a
    for t in (min(first, second), max(first, second)):
        x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
        local = mean + slope * z
        if t < NEAREST or abs(z) > half or local <= 0.0:
            continue
        u = mean * np.arctan2(x, y)
        if _is_open(k, hole, pitch, opening, extent, u, z):
            continue
        return t, u, z, abs(x * dx + y * dy - slope * local * dz) / (local * np.sqrt(1 + slope * slope))
    return np.inf, 0.0, 0.0, 0.0


@_jit
def _in_sight(s: Packed, origin, axis, spread: float, found) -> int:  # type: ignore[no-untyped-def]
    """Numbers of the surfaces whose bounding sphere meets the cone of half angle `spread` about `axis`."""
    count = 0
    for k in range(len(s.kind)):
        along = square = 0.0
        for i in range(3):
            offset = s.centre[k, i] - origin[i]
            along += offset * axis[i]
            square += offset * offset
        away = np.sqrt(square)
        if away > s.radius[k]:
            angle = np.arccos(min(1.0, max(-1.0, along / away)))
            if angle > spread + np.arcsin(s.radius[k] / away):
                continue
        found[count] = k
        count += 1
    return count


@_jit
def _tile(origin, turn, start, step, top, bottom, left, right, s, found) -> int:  # type: ignore[no-untyped-def]
    """Surfaces in sight of rays top … bottom − 1, left … right − 1; returns their number."""
    corners = np.empty((5, 3))
    rows = np.array([(top + bottom - 1) / 2, top, top, bottom - 1, bottom - 1])
    columns = np.array([(left + right - 1) / 2, left, right - 1, left, right - 1])
    for n in range(5):
        x, y = start[0] + columns[n] * step[0], start[1] + rows[n] * step[1]
        length = np.sqrt(x * x + y * y + 1.0)
        for i in range(3):
            corners[n, i] = (turn[i, 0] * x + turn[i, 1] * y + turn[i, 2]) / length
    spread = 0.0
    for n in range(1, 5):
        spread = max(spread, np.arccos(min(1.0, (corners[0] * corners[n]).sum())))
    return int(_in_sight(s, origin, corners[0], spread + 1e-9, found))


@_jit
def cast_rows(s, origin, turn, start, step, first, last, distance, strength) -> None:  # type: ignore[no-untyped-def]
    """Fill rows first … last − 1 of `distance` and `strength`; see `cast`."""
    # Out of the tuple once, for the same reason.
    kind, size, relief, heights = s.kind, s.size, s.relief, s.heights
    hole, pitch, opening, extent = s.hole, s.pitch, s.opening, s.extent
    columns, total = distance.shape[1], len(kind)
    found = np.empty(total, np.int64)
    at, into = np.zeros((total, 3)), np.zeros((total, 3, 3))
    for k in range(total):
        for i in range(3):
            for j in range(3):
                at[k, i] += s.axes[k, i, j] * (origin[j] - s.centre[k, j])
                for m in range(3):
                    into[k, i, m] += s.axes[k, i, j] * turn[j, m]
    for top in range(first, last, TILE):
        bottom = min(top + TILE, last)
        for left in range(0, columns, TILE):
            right = min(left + TILE, columns)
            count = _tile(origin, turn, start, step, top, bottom, left, right, s, found)
            for row in range(top, bottom):
                y = start[1] + row * step[1]
                for column in range(left, right):
                    x = start[0] + column * step[0]
                    nearest, u, v, slant, hit = np.inf, 0.0, 0.0, 0.0, -1
                    for index in range(count):
                        k = found[index]
                        ox, oy, oz = at[k, 0], at[k, 1], at[k, 2]
                        dx = into[k, 0, 0] * x + into[k, 0, 1] * y + into[k, 0, 2]
                        dy = into[k, 1, 0] * x + into[k, 1, 1] * y + into[k, 1, 2]
                        dz = into[k, 2, 0] * x + into[k, 2, 1] * y + into[k, 2, 2]
                        if kind[k] == SPHERE:
                            found_hit = _hit_sphere(k, size, ox, oy, oz, dx, dy, dz)
                        elif kind[k] == FRUSTUM:
                            found_hit = _hit_frustum(
                                k, size, hole, pitch, opening, extent, ox, oy, oz, dx, dy, dz
                            )
                        else:
                            found_hit = _hit_flat(
                                k, kind, size, relief, heights, hole, pitch, opening, extent,
                                ox, oy, oz, dx, dy, dz,
                            )  # fmt: skip
                        if found_hit[0] < nearest:
                            nearest, u, v, slant = found_hit
                            hit = k
                    length = np.sqrt(x * x + y * y + 1.0)
                    distance[row, column] = nearest * length
                    strength[row, column] = 0.0
                    if hit >= 0:
                        light = _reflectivity(s, hit, u, v) * slant / length
                        strength[row, column] = light / (nearest * length) ** 2


def cast(
    surfaces: Packed,
    origin: NDArray[np.float64],
    turn: NDArray[np.float64],
    start: tuple[float, float],
    step: tuple[float, float],
    shape: tuple[int, int],
    workers: int = 2,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cast a flat grid of rays on `workers` threads.

    Ray (row, column) goes from `origin` along turn · (start_x + column · step_x, start_y + row · step_y, 1).

    Args:
        surfaces: from `Scene.packed`.
        origin: (3,) metres. turn: (3, 3) takes the grid's axes to the scene's.
        start, step: (x, y) of the first ray and between rays, on the plane z = 1.
        shape: rows and columns of rays.

    Returns:
        distance (metres, infinite where nothing is hit) and strength, both of `shape`: reflectivity ·
        cos(incidence) / distance² (1/m²), what a matt surface sends back to a lamp beside the lens.
    """
    from concurrent.futures import ThreadPoolExecutor

    distance, strength = np.empty(shape), np.empty(shape)
    edges = [*range(0, shape[0], TILE), shape[0]]
    view = (surfaces, np.asarray(origin, float), np.ascontiguousarray(turn), np.array(start), np.array(step))
    with ThreadPoolExecutor(workers) as pool:
        jobs = [
            pool.submit(cast_rows, *view, first, last, distance, strength) for first, last in pairwise(edges)
        ]
        for job in jobs:
            job.result()
    return distance, strength
