"""Flat walls with systematic errors on them: planes and errors fitted together.

measured = true + constant + Σ a_h sin(2π h · measured / range) + b_h cos(…) + pixel, the true distance along
a unit ray r being 1 / (q · r) for a wall with q = normal / perpendicular distance. Known perpendicular
distances enter as constraints |q| = 1 / distance; without them, the walls' flatness alone tells the constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration, CyclicTerm
from service.calibration.still import Still
from service.errors import CalibrationError

STEPS = 30
OUTLIER = 4.0
"""Robust deviations from the wall at which a pixel is taken for something else than wall."""

LEAST_SHARE = 0.3
"""Of the image that has to show the wall."""

KNOWN_WEIGHT = 1e6
"""Of a known distance against one pixel: it holds to well under a millimetre."""


@dataclass(frozen=True)
class Wall:
    """One flat wall.

    Attributes:
        still: the mean of its frames.
        distance: perpendicular distance from the camera's projection centre, metres, or None.
    """

    still: Still
    distance: float | None


@dataclass(frozen=True)
class Solution:
    """Planes (K, 3), constant, (2 per harmonic) sine and cosine parts, and the covariance of the last two."""

    planes: NDArray[np.float64]
    shared: NDArray[np.float64]
    covariance: NDArray[np.float64]


class WallFit:
    """Gauss–Newton over the walls' planes and what all walls share, on pixels that show the wall."""

    def __init__(self, walls: Sequence[Wall], calibration: Calibration) -> None:
        self._walls = walls
        self._range = walls[0].still.ambiguity_range
        self._shape = walls[0].still.distance.shape
        self._rays = rays_of(calibration)
        self._weights = [_weights(wall.still) for wall in walls]
        self._on_wall = [
            self._wall_pixels(wall.still.distance, weight)
            for wall, weight in zip(walls, self._weights, strict=True)
        ]

    def solve(self, harmonics: Sequence[int], pattern: NDArray[np.float64] | None = None) -> Solution:
        """The least squares solution; `pattern` (H, W) is taken as known."""
        count, size = len(self._walls), 1 + 2 * len(harmonics)
        planes = np.array(
            [
                _plane(self._rays[on], d[on], weight[on])
                for (d, on), weight in zip(self._measured(), self._weights, strict=True)
            ]
        )
        shared = np.zeros(size)
        normal = np.eye(3 * count + size)
        for _ in range(STEPS):
            normal, gradient = np.zeros((3 * count + size,) * 2), np.zeros(3 * count + size)
            for k, (measured, on) in enumerate(self._measured()):
                error, jacobian = self._linearised(planes[k], shared, measured[on], on, harmonics, pattern)
                weighted = jacobian * self._weights[k][on][:, None]
                rows = np.r_[3 * k : 3 * k + 3, 3 * count : 3 * count + size]
                normal[np.ix_(rows, rows)] += weighted.T @ jacobian
                gradient[rows] += weighted.T @ error
                known = self._walls[k].distance
                if known is not None:
                    length = float(np.linalg.norm(planes[k]))
                    slope = -planes[k] / length**3
                    normal[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += KNOWN_WEIGHT * np.outer(slope, slope)
                    gradient[3 * k : 3 * k + 3] += KNOWN_WEIGHT * slope * (known - 1 / length)
            step = np.linalg.lstsq(normal, gradient, rcond=1e-13)[0]
            planes, shared = planes + step[: 3 * count].reshape(-1, 3), shared + step[3 * count :]
            if np.abs(step[3 * count :]).max() < 1e-7:
                break
        covariance = np.asarray(np.linalg.pinv(normal), dtype=np.float64)[3 * count :, 3 * count :]
        solution = Solution(planes, shared, covariance)
        variance = self.rms(solution, harmonics, pattern) ** 2
        return replace(solution, covariance=np.asarray(covariance * variance, dtype=np.float64))

    def split_by_span(self, harmonics: Sequence[int]) -> tuple[tuple[int, ...], list[str]]:
        """Harmonics of which the walls show at least one period, and why not the others."""
        seen = np.concatenate([measured[on] for measured, on in self._measured()])
        near, far = np.percentile(seen, (1, 99))
        spanned = tuple(h for h in harmonics if far - near >= self._range / h)
        missing = [
            f"harmonic {h} left out: its period is {self._range / h:.2f} m, the walls span {far - near:.2f} "
            "m (add walls nearer and farther, or one seen at a slant)"
            for h in harmonics
            if h not in spanned
        ]
        return spanned, missing

    def strength(self, solution: Solution, harmonics: Sequence[int], harmonic: int) -> float:
        """Amplitude of a harmonic over its standard deviation."""
        at = 1 + 2 * list(harmonics).index(harmonic)
        part = solution.shared[at : at + 2]
        spread = np.sqrt(np.trace(solution.covariance[at : at + 2, at : at + 2]) / 2)
        return float(np.linalg.norm(part) / max(spread, 1e-12))

    def read(
        self, solution: Solution, harmonics: Sequence[int]
    ) -> tuple[float, tuple[CyclicTerm, ...], float]:
        """Constant, cyclic terms, and the constant's standard deviation."""
        terms = []
        for n, harmonic in enumerate(harmonics):
            sine, cosine = solution.shared[1 + 2 * n : 3 + 2 * n]
            terms.append(
                CyclicTerm(
                    amplitude=float(np.hypot(sine, cosine)),
                    harmonic=harmonic,
                    phase=float(np.arctan2(cosine, sine)),
                )
            )
        return float(solution.shared[0]), tuple(terms), float(np.sqrt(solution.covariance[0, 0]))

    def pattern(self, solution: Solution, harmonics: Sequence[int]) -> NDArray[np.float64]:
        """(H, W) mean residual of each pixel over the walls; 0 where no wall was seen."""
        total, seen = np.zeros(self._shape), np.zeros(self._shape)
        for k, (measured, on) in enumerate(self._measured()):
            error, _ = self._linearised(
                solution.planes[k], solution.shared, measured[on], on, harmonics, None
            )
            total[on] += error * self._weights[k][on]
            seen[on] += self._weights[k][on]
        mean = total / np.maximum(seen, 1e-9)
        return np.where(seen > 0, mean - mean[seen > 0].mean(), 0.0)

    def rms(
        self,
        solution: Solution,
        harmonics: Sequence[int],
        pattern: NDArray[np.float64] | None = None,
    ) -> float:
        """Weighted RMS residual, metres: of a pixel of median brightness."""
        total = count = 0.0
        for k, (d, on) in enumerate(self._measured()):
            error, _ = self._linearised(solution.planes[k], solution.shared, d[on], on, harmonics, pattern)
            total += float(self._weights[k][on] @ error**2)
            count += float(self._weights[k][on].sum())
        return float(np.sqrt(total / count))

    def profile(self, solution: Solution) -> NDArray[np.float64]:
        """(2, M) expected measured distance and residual plus constant, in up to 60 bins of distance.

        Binned by what is expected: among like distances, those that measured near would have low errors.
        """
        expected, errors = [], []
        for k, (measured, on) in enumerate(self._measured()):
            error, _ = self._linearised(solution.planes[k], solution.shared, measured[on], on, (), None)
            expected.append(measured[on] - error)
            errors.append(error + solution.shared[0])
        distance, error = np.concatenate(expected), np.concatenate(errors)
        groups = [group for group in np.array_split(np.argsort(distance), 60) if group.size]
        return np.array([[distance[g].mean() for g in groups], [error[g].mean() for g in groups]])

    def _linearised(
        self,
        plane: NDArray[np.float64],
        shared: NDArray[np.float64],
        measured: NDArray[np.float64],
        on: NDArray[np.bool_],
        harmonics: Sequence[int],
        pattern: NDArray[np.float64] | None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Residual of each pixel and its derivative by plane and shared parameters."""
        rays = self._rays[on]
        true = 1 / (rays @ plane)
        base = true if pattern is None else true + pattern[on]
        expected = base + shared[0]
        # The phase of what is expected, not of what was measured: noise in both would seem cyclic.
        for _ in range(3):
            model = self._model(expected, harmonics)
            expected = base + model @ shared
        return measured - expected, np.concatenate([-(true**2)[:, None] * rays, model], axis=1)

    def _model(self, distance: NDArray[np.float64], harmonics: Sequence[int]) -> NDArray[np.float64]:
        """(M, 1 + 2 per harmonic) derivative of the error by the shared parameters."""
        columns = [np.ones_like(distance)]
        for harmonic in harmonics:
            phase = 2 * np.pi * harmonic * distance / self._range
            columns += [np.sin(phase), np.cos(phase)]
        return np.stack(columns, axis=1)

    def _measured(self) -> list[tuple[NDArray[np.float64], NDArray[np.bool_]]]:
        return [(wall.still.distance, on) for wall, on in zip(self._walls, self._on_wall, strict=True)]

    def _wall_pixels(self, distance: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(H, W) pixels within the noise and the systematic errors of the flat wall."""
        measured = np.isfinite(distance) & (weight > 0)
        on = measured
        for _ in range(10):
            if on.mean() < LEAST_SHARE:
                raise CalibrationError(
                    f"{100 * on.mean():.0f} % of the image show one flat wall, at least "
                    f"{100 * LEAST_SHARE:.0f} % are needed: fill the view with it"
                )
            plane = _plane(self._rays[on], distance[on], weight[on])
            error = np.abs(distance - 1 / (self._rays @ plane)) * np.sqrt(weight)
            keep = measured & (error < OUTLIER * float(np.median(error[on])) / 0.6745)
            if (keep == on).all():
                break
            on = keep
        return on


def _weights(still: Still) -> NDArray[np.float64]:
    """(H, W) 1 / variance against a pixel of median brightness, at most 1; 0 where nothing was measured.

    σ ∝ 1 / amplitude; brighter pixels are no better, since systematic errors are left in them.
    """
    bright = np.nan_to_num(still.amplitude, nan=0.0)
    middle = float(np.median(bright[bright > 0])) if np.any(bright > 0) else 1.0
    weight: NDArray[np.float64] = np.minimum(1.0, (bright / middle) ** 2)
    return weight


def rays_of(calibration: Calibration) -> NDArray[np.float64]:
    """(H, W, 3) unit rays of the pixels, camera axes."""
    from solver.lens import pixel_rays

    slopes = pixel_rays(calibration.shape, calibration.intrinsics.matrix, calibration.distortion)
    rays = np.concatenate([slopes[..., :2], np.ones((*calibration.shape, 1))], axis=2)
    unit: NDArray[np.float64] = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    return unit


def _plane(
    rays: NDArray[np.float64], distance: NDArray[np.float64], weight: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(3,) q of the plane through the points distance · ray, by least squares of distance · (q · ray) = 1."""
    root = np.sqrt(weight)
    return np.asarray(np.linalg.lstsq(rays * (distance * root)[:, None], root, rcond=None)[0])
