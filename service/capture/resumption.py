"""A burst that a crash or a restart interrupted, taken up again from what was recorded of it."""

import logging
import tomllib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import DriverError
from drivers.frame import Frame
from drivers.recording import Recording, open_recording
from drivers.recording.locks import is_used
from drivers.recording.output import WORKING_SUFFIX
from service.capture.rig import Rig
from service.config.sections import Configuration
from service.files import recordings_in

LONGEST_BREAK = 600.0
"""Seconds after which the scene is another one."""

_SAME = ("camera", "stage", "plan", "fusion")
"""Sections that must be what they were."""

_LOOKED_AT = 3
"""Recordings in which the last frame is looked for."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class BegunBurst:
    """The first poses of a burst.

    Attributes:
        number: of the burst.
        frames: of poses 0 to `len(frames) - 1`.
    """

    number: int
    frames: Sequence[Frame]


def begun_burst(configuration: Configuration, rig: Rig, poses: int) -> BegunBurst | None:
    """What the newest recording holds of an unfinished burst; None, said in the log, where there is none.

    Args:
        configuration: in force.
        rig: open.
        poses: of a whole burst.
    """
    try:
        recording = _newest(configuration.recording.directory)
        if recording is None:
            return None
        number, frames, why = _unfinished(recording, configuration, rig, poses)
    except DriverError as error:
        number, frames, why = 0, [], str(error)
    if why:
        _log.info("the scan begins anew: %s", why)
        return None
    if not frames:
        return None
    _log.info("burst %d is resumed at pose %d of %d", number, len(frames), poses)
    return BegunBurst(number, frames)


def _newest(directory: Path) -> Recording | None:
    """The newest that holds a frame and that nobody writes: this run or another one may have begun it."""
    try:
        newest = recordings_in(directory)[: -_LOOKED_AT - 1 : -1]
    except OSError:
        return None
    for path in newest:
        with suppress(DriverError, OSError):  # without a frame, no recording at all, or renamed meanwhile
            if not (path.suffix == WORKING_SUFFIX and is_used(path)):
                return open_recording(path)
    return None


def _unfinished(
    recording: Recording, configuration: Configuration, rig: Rig, poses: int
) -> tuple[int, list[Frame], str]:
    """Number and frames of its last burst, and why it cannot be resumed; no frames where it is complete."""
    bursts = recording.cut(None)
    if not bursts or bursts[-1][0].fields.burst is None:
        return 0, [], ""
    last = bursts[-1]
    number, newest = last[0].fields.burst, last[-1].fields.timestamp
    if number is None or len(last) >= poses:
        return 0, [], ""
    why = _hindrance(recording, configuration, rig, newest)
    if not why and [entry.fields.pose for entry in last] != list(range(len(last))):
        why = f"burst {number} was interrupted more than once"
    frames = [] if why else [frame for frame in recording.frames() if frame.burst == number]
    return number, frames[-len(last) :], why


def _hindrance(recording: Recording, configuration: Configuration, rig: Rig, newest: int) -> str:
    age = (rig.clock.now() - newest) * 1e-9
    if not 0 <= age <= LONGEST_BREAK:
        return f"what was interrupted is {age:.0f} s old, at most {LONGEST_BREAK:.0f} s are allowed"
    if recording.metadata.get("rig", configuration.zenoh.prefix) != configuration.zenoh.prefix:
        return "what was interrupted is of another rig"
    used = tomllib.loads(recording.configuration or "")
    now = configuration.model_dump(mode="json", exclude_none=True)
    other = [name for name in _SAME if used.get(name) != now[name]]
    if other:
        return f"{', '.join(other)} differ from what was interrupted"
    if recording.calibration != rig.calibration:
        return "the calibration differs from that of what was interrupted"
    commands = [record for record in recording.contents.metadata if record.name == "command"]
    if any('"set"' in record.metadata.get("arguments", "") for record in commands):
        return "settings were changed on command before it was interrupted"
    if any(int(record.metadata.get("when", "0")) > newest for record in commands):
        return "it was ended on command"
    return ""
