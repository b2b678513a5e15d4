"""Frames on their way from other programs' files into a recording."""

from collections.abc import Callable
from pathlib import Path

from pydantic import BaseModel, Field

from drivers.errors import RecordingError
from drivers.frame import AmplitudeMode
from drivers.importers import Import
from drivers.recording import RecordingWriter, recording_head
from service.jobs.prefetch import prefetched

_AHEAD = 8
"""Frames that are read while others are compressed and written."""


class ImportSummary(BaseModel):
    """What was imported."""

    recording: Path
    size: int = Field(description="Bytes.")
    frames: int
    bursts: int
    shape: tuple[int, int] = Field(description="Rows and columns.")
    camera: str
    modulation_frequency: float | None = Field(description="Hz; null = none, or not known.")
    ambiguity_range: float | None = Field(description="Metres; null = none, or not known.")
    integration_time: float | None = Field(description="Seconds per phase sample; null = not known.")
    amplitude_mode: AmplitudeMode | None = Field(description="Null = the camera gives no amplitude.")
    optics: str = Field(description="Where the optics come from.")
    optics_residual: float | None = Field(
        description="Pixels, root mean square, of optics that were fitted to the files; null = not fitted."
    )
    focal_length: tuple[float, float] = Field(description="Along columns and rows, pixels.")
    centre: tuple[float, float] = Field(description="Principal point: column and row, pixels.")
    rejected: float = Field(description="Part of all pixels that are rejected, 0 to 1.")
    notes: list[str] = Field(description="What was assumed or looks odd.")
    lost: list[str] = Field(description="What could not be read.")

    def __str__(self) -> str:
        time = "not known" if self.integration_time is None else f"{self.integration_time * 1e3:g} ms"
        return (
            f"{self.recording}: {self.frames} frames of {self.shape[1]} × {self.shape[0]} pixels in "
            f"{self.bursts} burst{'' if self.bursts == 1 else 's'}, {self.size / 1e6:.2f} MB\n"
            f"{self.camera}{self._carrier}, integration time {time}, amplitude "
            f"{self.amplitude_mode or 'not there'}, "
            f"{self.rejected:.1%} of pixels rejected\n"
            f"focal length {' × '.join(f'{f:.1f}' for f in dict.fromkeys(self.focal_length))} pixels, "
            f"centre {self.centre[0]:.1f}, {self.centre[1]:.1f} ({self.optics})"
        )

    @property
    def _carrier(self) -> str:
        if self.modulation_frequency is None or self.ambiguity_range is None:
            return ""
        return f" at {self.modulation_frequency / 1e6:g} MHz (range {self.ambiguity_range:.3f} m)"


def record_import(
    found: Import, output: Path, frames_per_burst: int | None, advance: Callable[[], None]
) -> ImportSummary:
    """Write a recording of imported frames, with the camera's calibration.

    Args:
        advance: called after each frame.

    Raises:
        RecordingError: a file cannot be read, or none holds a frame; no recording is left then.
        StorageError: the recording cannot be written.
    """
    rejected, last = 0.0, None
    head = recording_head(
        source="import",
        camera_model=found.source.model,
        camera_serial=found.source.serial,
        frames_per_burst=frames_per_burst or found.count,
    )
    with RecordingWriter(output, head.metadata, whole=True) as writer:
        for frame in prefetched(found.frames(), _AHEAD):
            if last is None:
                writer.write_calibration(found.calibration, frame.timestamp)
            writer.write_frame(frame, found.calibration.mount)
            rejected += float(1 - (frame.counts > 0).mean())
            last = frame
            advance()
        if last is None:
            raise RecordingError("the files hold no frame; name files that hold some")
    frames, optics = last.sequence + 1, found.calibration.intrinsics
    return ImportSummary(
        recording=output,
        size=output.stat().st_size,
        frames=frames,
        bursts=1 if last.burst is None else last.burst + 1,
        shape=last.shape,
        camera=found.source.model,
        modulation_frequency=last.modulation_frequency,
        ambiguity_range=last.ambiguity_range,
        integration_time=last.integration_time,
        amplitude_mode=last.amplitude_mode if last.has_amplitude else None,
        optics=found.calibration.source,
        optics_residual=found.optics_residual,
        focal_length=(optics.fx, optics.fy),
        centre=(optics.cx, optics.cy),
        rejected=rejected / frames,
        notes=found.findings.notes,
        lost=found.findings.lost,
    )
