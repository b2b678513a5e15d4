"""A few frames for a quick look: a recording, and a picture of what is in it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from drivers.frame import Frame
from drivers.recording import RecordingWriter
from service.calibration.still import reduce_still
from service.capture.head import head_of
from service.capture.rig import Rig
from service.config.sections import Configuration
from service.errors import ServiceError


def record_frames(path: Path, frames: Iterable[Frame], rig: Rig, configuration: Configuration) -> list[Frame]:
    """Write frames as they come, with the calibration and the configuration; nothing is left of a failure.

    Raises:
        ServiceError: no frame came.
        StorageError, and as `Camera.grab`.
    """
    head = head_of(configuration, rig.camera.capabilities, rig.calibration)
    kept: list[Frame] = []
    with RecordingWriter(path, head.metadata) as writer:
        head.attach_to(writer, rig.clock.now())
        for frame in frames:
            if not kept:
                writer.write_calibration(rig.calibration, frame.timestamp)
            writer.write_frame(frame, rig.calibration.mount)
            kept.append(frame)
        if not kept:
            raise ServiceError("no frame came: is the recording that is played empty?")
    return kept


def draw_frames(path: Path, frames: list[Frame]) -> None:
    """PNG of the first frame's distance and amplitude and, for several still ones, their noise."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    first = frames[0]
    figure = Figure(figsize=(16, 5), layout="constrained")
    FigureCanvasAgg(figure)
    panels = [("distance, m", first.distance, "viridis")]
    if first.amplitude is not None:
        panels.append(("amplitude, counts", first.amplitude.astype(np.float32), "gray"))
    if len(frames) > 1:
        deviations = reduce_still(frames).deviations
        panels.append(("noise over time, mm", 1e3 * np.sqrt(np.mean(deviations**2, axis=0)), "magma"))
    for axes, (title, image, colours) in zip(
        figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True
    ):
        known = image[np.isfinite(image)]
        low, high = np.percentile(known, (1, 99)) if known.size else (0.0, 1.0)
        shown = axes.imshow(image, cmap=colours, vmin=low, vmax=max(high, low + 1e-6))
        figure.colorbar(shown, ax=axes, shrink=0.8)
        axes.set_title(title)
    figure.savefig(path, format="png", dpi=100)
