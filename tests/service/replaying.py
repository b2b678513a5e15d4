"""Small recordings to be played: bursts of tiny frames, one every 0.1 s."""

from pathlib import Path

from commanding import configuration
from scripted import calibration, frame

from drivers.recording import RecordingWriter
from service.config.sections import Configuration

PERIOD = 100_000_000
START = 1_700_000_000_000_000_000
BURSTS, FRAMES = 5, 4


def record(path: Path, *, bursts: int = BURSTS, jump: int = 0) -> Path:
    """A recording; before its third burst the clock jumps by so many ns."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with RecordingWriter(path, {"camera_model": "recorded", "camera_serial": "7"}) as writer:
        writer.attach_calibration(calibration(), START)
        for number in range(bursts * FRAMES):
            burst, pose = divmod(number, FRAMES)
            at = START + number * PERIOD + (jump if burst >= 2 else 0)
            writer.write_frame(frame(number, at, burst=burst + 10, pose=pose), calibration().mount)
    return path


def playable(folder: Path, endpoint: str, **sections: object) -> Configuration:
    """A service with a recording folder that holds `five.mcap`, five bursts of four frames."""
    record(folder / "kept" / "five.mcap")
    recording = {"directory": str(folder / "kept"), **sections.pop("recording", {})}  # type: ignore[dict-item]
    return configuration(folder, endpoint, recording=recording, **sections)
