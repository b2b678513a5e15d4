"""Recordings: MCAP files of frames with calibration, configuration and truth."""

from drivers.recording import attachments
from drivers.recording.compression import Compression
from drivers.recording.damage import Damage
from drivers.recording.head import RecordingHead, recording_head
from drivers.recording.output import torn_path
from drivers.recording.reader import Recording, open_recording
from drivers.recording.recover import recover, recovered_path
from drivers.recording.summary import RecordingSummary
from drivers.recording.writer import RecordingWriter

__all__ = [
    "Compression",
    "Damage",
    "Recording",
    "RecordingHead",
    "RecordingSummary",
    "RecordingWriter",
    "attachments",
    "open_recording",
    "recording_head",
    "recover",
    "recovered_path",
    "torn_path",
]
