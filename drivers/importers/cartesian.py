"""Frames of an SR4000 as its vendor's library delivers them: points, amplitude and confidence."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.calibration import Calibration, sr4000_calibration
from drivers.errors import RecordingError
from drivers.importers.exposure import Exposure, Findings, ImportOptions, Source, check_size
from drivers.importers.optics import Optics, fit_optics
from drivers.importers.points import (
    ORIGIN_BEFORE_CENTRE,
    Points,
    camera_points,
    comparable,
    cosines,
    direction_error,
    radial_counts,
    whole_amplitude,
)

SHAPE = (144, 176)
FREQUENCY = 30e6
"""Hz, the frequency at which SR4000 are calibrated unless they were ordered otherwise."""

OTHER_CAMERA = 0.25
"""Pixels, median. Frames of one camera agree within 0.02; the centres of two lay 3.4 apart."""

WRONG_DIRECTIONS = 1.0
"""Pixels, median; what a calibration given by the user may be off."""

STRAY = 0.5
"""Pixels that a single point may lie off; at most 0.2 on real frames, and 1 where an image lost a row."""

NEAREST, ASIDE = 0.02, 0.001
"""Metres: nearer points are not compared at all; a millimetre is no damage, numbers are rounded to 0.1 mm."""

DAMAGED = 0.05
"""Part of the points that may lie off their rays before the whole frame is refused."""


_STORED = ("z", "x", "y", "amplitude", "confidence", "time")


@dataclass(frozen=True, slots=True)
class CartesianFrame:
    """One frame as a file holds it.

    Attributes:
        z: (H, W) metres along the optical axis, from 10 mm in front of the projection centre.
        x, y: (H, W) metres to the image's left and up; None = not stored.
        amplitude: (H, W).
        confidence: (H, W), 0 = the camera could not tell; None = not stored.
        time: ns; None = not stored.
    """

    z: Points
    x: Points | None
    y: Points | None
    amplitude: Points
    confidence: Points | None
    time: int | None

    def trusted(self) -> NDArray[np.bool_]:
        """(H, W), the pixels that are not rejected."""
        told = (self.z > -ORIGIN_BEFORE_CENTRE) & np.isfinite(self.z) & np.isfinite(self.amplitude)
        return told if self.confidence is None else told & (self.confidence > 0)

    @property
    def kind(self) -> str:
        """What is stored, in words."""
        return ", ".join(name for name in _STORED if getattr(self, name) is not None)

    def points(self) -> Points | None:
        """(H, W, 3) in camera axes, or None where x and y are not stored."""
        return None if self.x is None or self.y is None else camera_points(self.x, self.y, self.z)


class Reader(Protocol):
    """Reads the one frame of a file."""

    def __call__(self, path: Path, findings: Findings) -> CartesianFrame: ...


@dataclass(frozen=True, slots=True)
class CartesianFormat:
    """Files of one such frame each."""

    parse: Reader

    def source(self, paths: Sequence[Path], options: ImportOptions, findings: Findings) -> Source:
        """An SR4000, in gray mode as the vendor's defaults have it, with the optics that the files show.

        Raises:
            RecordingError: a file cannot be read, or its points come from no lens.
        """
        fitted = None if options.calibration else self._optics(paths, findings)
        if options.amplitude_mode is None:
            findings.note("amplitude is taken to be in gray mode, the vendor's default: the files do not say")
        if fitted is None:
            return Source("SR4000", None, sr4000_calibration(), FREQUENCY, "gray")
        path, optics = fitted
        return Source(
            "SR4000", None, _calibration(optics, path), FREQUENCY, "gray", optics_residual=optics.residual
        )

    def count(self, path: Path) -> int:  # noqa: ARG002
        """Frames in a file."""
        return 1

    def read(
        self, paths: Sequence[Path], source: Source, options: ImportOptions, findings: Findings
    ) -> Iterator[tuple[Path, Exposure]]:
        """The one exposure of each file.

        Raises:
            RecordingError: not such a file, torn, of another kind than the first, or of another camera than
                `source`.
        """
        kind = None
        for path in paths:
            frame = self.parse(path, findings)
            kind = kind or frame.kind
            if frame.kind != kind:
                raise RecordingError(
                    f"{path}: holds {frame.kind}, the files before it {kind}: import each kind by itself"
                )
            yield path, _exposure(frame, path, source, options, findings)

    def _optics(self, paths: Sequence[Path], findings: Findings) -> tuple[Path, Optics] | None:
        """From the first file that has enough points; None where no file has."""
        for path in paths:
            frame = self.parse(path, Findings())
            points = frame.points()
            if points is None or frame.z.shape != SHAPE:
                return None
            try:
                found = fit_optics(points, comparable(points, frame.trusted()))
            except RecordingError as error:
                raise RecordingError(
                    f"{path}: {error}; if the file is right, name the camera's calibration (--calibration)"
                ) from error
            if found is not None:
                return path, found
        findings.note(
            "the points of every file's x, y, z are too few, or in too small a part of the image, to fit the "
            "optics: nominal ones are kept"
        )
        return None


def _exposure(
    frame: CartesianFrame, path: Path, source: Source, options: ImportOptions, findings: Findings
) -> Exposure:
    calibration = options.calibration or source.calibration or sr4000_calibration()
    check_size(frame.z.shape, calibration, path)
    trusted, points = frame.trusted(), frame.points()
    if frame.confidence is None:
        findings.note("no confidence is stored: no pixel with a distance is rejected")
    if points is None:
        radius = (frame.z + ORIGIN_BEFORE_CENTRE) / cosines(calibration)
        findings.note(f"only z is stored: it became radial distance along the rays of {_whose(options)}")
    else:
        with np.errstate(over="ignore"):
            radius = np.linalg.norm(np.where(trusted[..., None], points, 0.0), axis=-1)
        if options.calibration is None and source.optics_residual is not None:
            trusted &= ~_strays(points, trusted, calibration, path, findings)
        else:
            _compare(points, trusted, calibration, path, findings)
    frequency = source.carrier(options)
    return Exposure(
        counts=radial_counts(radius, trusted, frequency, path),
        amplitude=whole_amplitude(frame.amplitude, path),
        time=frame.time,
    )


def _calibration(optics: Optics, path: Path) -> Calibration:
    source = f"fitted to x, y, z of {path.name}: residual {optics.residual:.3f} px"
    return optics.calibration(sr4000_calibration(), source)


def _whose(options: ImportOptions) -> str:
    if options.calibration:
        return "the calibration given"
    return "nominal optics, which can be pixels off: better name the camera's own (--calibration)"


def _compare(
    points: Points, trusted: NDArray[np.bool_], calibration: Calibration, path: Path, findings: Findings
) -> None:
    """Say where the points do not fit a calibration that does not come from them."""
    error = direction_error(points, comparable(points, trusted), calibration)
    known = error[np.isfinite(error)]
    if known.size and np.median(known) > WRONG_DIRECTIONS:
        findings.note(
            f"points of {path.name} lie {np.median(known):.1f} pixels (median) from where the calibration "
            "puts them: check that it is this camera's"
        )


def _strays(
    points: Points, trusted: NDArray[np.bool_], calibration: Calibration, path: Path, findings: Findings
) -> NDArray[np.bool_]:
    """(H, W), points that do not lie on their pixel's ray of the optics that were fitted to the files."""
    known = comparable(points, trusted, NEAREST)
    error = direction_error(points, known, calibration)
    aside = error * points[..., 2] / calibration.intrinsics.fx
    strays: NDArray[np.bool_] = (error > STRAY) & (aside > ASIDE)
    far = comparable(points, trusted)
    median = float(np.median(error[far])) if far.any() else 0.0
    if median > OTHER_CAMERA or strays.sum() > DAMAGED * known.sum():
        raise RecordingError(
            f"{path}: its points lie {median:.2f} pixels (median) off the rays of the camera "
            f"({calibration.source}), {strays.sum() / known.sum():.0%} of them by more than {STRAY}: it is "
            "damaged or of another camera; import each camera's files by themselves"
        )
    if strays.any():
        findings.lost.append(
            f"{path}: {strays.sum()} points do not lie on their pixel's ray, so their numbers are damaged: "
            "those pixels are rejected"
        )
    return strays
