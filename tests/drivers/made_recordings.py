"""Recordings for tests: written whole, and where their chunks lie."""

from mcap.reader import make_reader

from drivers.calibration import Mount
from drivers.recording import RecordingWriter


def write(path, frames, calibration=None, metadata=None):
    with RecordingWriter(path, metadata or {"rig": "bench", "run_id": "r1"}) as writer:
        if calibration is not None:
            writer.write_calibration(calibration, frames[0].timestamp)
        for frame in frames:
            writer.write_frame(frame, Mount(), log_time=frame.timestamp + 5_000_000)
    return path


def chunks(path):
    """(offset, length) of each chunk record."""
    with path.open("rb") as file:
        return [
            (at.chunk_start_offset, at.chunk_length) for at in make_reader(file).get_summary().chunk_indexes
        ]


def flipped(whole, tmp_path, position):
    content = bytearray(whole.read_bytes())
    content[position] ^= 0x10
    path = tmp_path / "flipped.mcap"
    path.write_bytes(content)
    return path
