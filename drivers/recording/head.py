"""What a recording begins with, whoever makes it."""

from dataclasses import dataclass, field

from drivers.calibration import Calibration
from drivers.recording import attachments
from drivers.recording.writer import RecordingWriter


@dataclass(frozen=True, slots=True)
class RecordingHead:
    """Metadata, and attachments as (name, content, media type)."""

    metadata: dict[str, str] = field(default_factory=dict)
    attachments: tuple[tuple[str, bytes, str], ...] = ()

    def attach_to(self, writer: RecordingWriter, log_time: int) -> None:
        """Write the attachments; `log_time` in ns since the epoch."""
        for name, content, media_type in self.attachments:
            writer.attach(name, content, media_type, log_time)


def recording_head(
    *,
    source: str,
    camera_model: str,
    camera_serial: str | None = None,
    rig: str | None = None,
    run_id: str | None = None,
    frames_per_burst: int | None = None,
    calibration: Calibration | None = None,
    configuration: str | None = None,
    truth: bytes | None = None,
) -> RecordingHead:
    """The head of a recording of known origin; what is None is left out.

    Args:
        source: `device`, `simulation`, `replay` or `import`.
        camera_model, camera_serial: of the camera.
        rig: which rig; `zenoh.prefix` of a running service.
        run_id: None = a new one.
        frames_per_burst: frames of a whole burst, so that a torn file can say what its last one lacks.
        calibration: of the camera.
        configuration: as used, TOML.
        truth: content of `truth.npz`.
    """
    said = {
        "source": source,
        "camera_model": camera_model,
        "camera_serial": camera_serial,
        "rig": rig,
        "run_id": run_id,
        attachments.FRAMES_PER_BURST: None if frames_per_burst is None else str(frames_per_burst),
    }
    attached = (
        (attachments.CALIBRATION, calibration.to_toml() if calibration else None, "application/toml"),
        (attachments.CONFIGURATION, configuration, "application/toml"),
        (attachments.TRUTH, truth, "application/octet-stream"),
    )
    return RecordingHead(
        {key: value for key, value in said.items() if value is not None},
        tuple((name, _bytes(content), kind) for name, content, kind in attached if content is not None),
    )


def _bytes(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content
