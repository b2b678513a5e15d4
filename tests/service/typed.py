"""`lidarboost` as it is typed, and recordings of tiny frames for it."""

from pathlib import Path

from scripted import calibration
from typer.testing import CliRunner, Result

from drivers import Frame
from drivers.calibration import Mount
from drivers.recording import RecordingWriter
from service.cli import app


def lidarboost(*words: object) -> Result:
    """What a command answers."""
    return CliRunner().invoke(app, [str(word) for word in words], prog_name="lidarboost")


def write(path: Path, frames: list[Frame], *, calibrated: bool = True) -> Path:
    """A recording of these frames."""
    with RecordingWriter(path) as writer:
        if calibrated:
            writer.write_calibration(calibration(), 0)
        for one in frames:
            writer.write_frame(one, Mount())
    return path


def torn(source: Path, target: Path, part: float) -> Path:
    """The first part of a recording."""
    data = source.read_bytes()
    target.write_bytes(data[: int(part * len(data))])
    return target
