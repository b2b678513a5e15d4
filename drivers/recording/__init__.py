"""Recordings: MCAP files of frames with calibration, configuration and truth."""

from drivers.recording.writer import RecordingWriter

__all__ = ["RecordingWriter"]
