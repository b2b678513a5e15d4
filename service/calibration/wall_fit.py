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
from service.calibration.wall import Wall, plane_through, rays_of, wall_pixels, weights_of

STEPS = 30
KNOWN_WEIGHT = 1e6
"""Of a known distance against one pixel: it holds to well under a millimetre."""


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
        self.ambiguity_range = walls[0].still.ambiguity_range
        self._shape = walls[0].still.distance.shape
        self._rays = rays_of(calibration)
        self._weights = [weights_of(wall.still) for wall in walls]
        self._on_wall = [
            wall_pixels(self._rays, wall.still.distance, weight, number)
            for number, (wall, weight) in enumerate(zip(walls, self._weights, strict=True), start=1)
        ]

    def solve(self, harmonics: Sequence[int], pattern: NDArray[np.float64] | None = None) -> Solution:
        """The least squares solution; `pattern` (H, W) is taken as known."""
        planes, shared = self._nearest_planes(), np.zeros(1 + 2 * len(harmonics))
        away = 1 / np.linalg.norm(planes, axis=1)
        true = np.array([wall.distance or measured for wall, measured in zip(self._walls, away, strict=True)])
        shared[0] = np.median(away - true)
        return self._iterate(harmonics, pattern, planes * (away / true)[:, None], shared)

    def _iterate(
        self,
        harmonics: Sequence[int],
        pattern: NDArray[np.float64] | None,
        planes: NDArray[np.float64],
        shared: NDArray[np.float64],
        *,
        fixed: bool = False,
    ) -> Solution:
        """Gauss–Newton from here; `fixed`: of the planes alone."""
        count, size = len(planes), len(shared)
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
            free = slice(3 * count if fixed else None)
            step = np.zeros(3 * count + size)
            step[free] = np.linalg.lstsq(normal[free, free], gradient[free], rcond=1e-13)[0]
            planes, shared = planes + step[: 3 * count].reshape(-1, 3), shared + step[3 * count :]
            if np.abs(step[free][-size:]).max() < 1e-7:
                break
        covariance = np.asarray(np.linalg.pinv(normal), dtype=np.float64)[3 * count :, 3 * count :]
        solution = Solution(planes, shared, covariance)
        variance = self.rms(solution, harmonics, pattern) ** 2
        return replace(solution, covariance=np.asarray(covariance * variance, dtype=np.float64))

    def split_by_span(self, harmonics: Sequence[int]) -> tuple[tuple[int, ...], list[str]]:
        """Harmonics of which the walls show at least one period, and why not the others."""
        seen = np.concatenate([measured[on] for measured, on in self._measured()])
        near, far = np.percentile(seen, (1, 99))
        spanned = tuple(h for h in harmonics if far - near >= self.ambiguity_range / h)
        missing = [
            f"harmonic {h} left out: its period is {self.ambiguity_range / h:.2f} m, the walls span "
            f"{far - near:.2f} m (add walls nearer and farther, or one seen at a slant)"
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
        weight = [self._weights[k][on].sum() for k, on in enumerate(self._on_wall)]
        return float(np.sqrt(np.average(self.wall_rms(solution, harmonics, pattern) ** 2, weights=weight)))

    def wall_rms(
        self,
        solution: Solution,
        harmonics: Sequence[int],
        pattern: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """(K,) the same of each wall."""
        found = []
        for k, (d, on) in enumerate(self._measured()):
            error, _ = self._linearised(solution.planes[k], solution.shared, d[on], on, harmonics, pattern)
            found.append(np.sqrt(np.average(error**2, weights=self._weights[k][on])))
        return np.array(found)

    def noise_rms(self) -> NDArray[np.float64]:
        """(K,) the noise of one frame of each wall, weighted alike, metres; NaN where there is one frame."""
        parts = zip(self._walls, self._on_wall, self._weights, strict=True)
        return np.array(
            [
                np.sqrt(np.average(np.mean(wall.still.deviations**2, axis=0)[on], weights=weight[on]))
                for wall, on, weight in parts
            ]
        )

    def measured_distances(self) -> NDArray[np.float64]:
        """(K,) perpendicular distances, metres, of the planes that lie nearest to what was measured."""
        return np.asarray(1 / np.linalg.norm(self._nearest_planes(), axis=1))

    def _nearest_planes(self) -> NDArray[np.float64]:
        return np.array(
            [
                plane_through(self._rays[on], d[on], weight[on])
                for (d, on), weight in zip(self._measured(), self._weights, strict=True)
            ]
        )

    def refit(
        self, solution: Solution, harmonics: Sequence[int], pattern: NDArray[np.float64] | None = None
    ) -> Solution:
        """Planes anew for what is shared as it is given, so that other frames are judged by it.

        Where a distance is known the plane keeps it: then what is shared alone explains the walls.
        """
        return self._iterate(harmonics, pattern, solution.planes, solution.shared, fixed=True)

    def profile(self, solution: Solution, harmonics: Sequence[int]) -> NDArray[np.float64]:
        """(2, M) expected measured distance and what it is off the planes, in up to 60 bins of distance.

        Binned by what is expected: among like distances, those that measured near would have low errors.
        """
        expected, errors = [], []
        for k, (measured, on) in enumerate(self._measured()):
            error, _ = self._linearised(
                solution.planes[k], solution.shared, measured[on], on, harmonics, None
            )
            expected.append(measured[on] - error)
            errors.append(measured[on] - 1 / (self._rays[on] @ solution.planes[k]))
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
            phase = 2 * np.pi * harmonic * distance / self.ambiguity_range
            columns += [np.sin(phase), np.cos(phase)]
        return np.stack(columns, axis=1)

    def _measured(self) -> list[tuple[NDArray[np.float64], NDArray[np.bool_]]]:
        return [(wall.still.distance, on) for wall, on in zip(self._walls, self._on_wall, strict=True)]
