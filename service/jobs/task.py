"""One recording to be fused, wherever that is done: here, in a process of a pool, on a cluster."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from drivers.errors import DriverError
from drivers.names import Shown
from drivers.recording import RecordingWriter, open_recording
from service.capture.configured import configured_calibration
from service.config.sections import CameraSection, FusionSection
from service.errors import ServiceError, internal
from service.files import made_directory
from service.jobs.fuse import Announce, fuse_recording
from service.jobs.result_name import Outcome, attach_outcome, outcome_of, result_path, working_file
from service.messages.map import FusedMap
from service.messages.summary import BurstSummary, summarize
from service.messages.viewing import Extras
from service.sinks.drawing import write_preview
from solver.errors import FusionError


@dataclass(frozen=True, slots=True)
class FuseTask:
    """A recording and what is to become of it; small, whatever the recording holds.

    Attributes:
        path: of the recording, as whoever fuses it sees it.
        fusion: how.
        calibration: TOML file that replaces the recording's own.
        extras: what is written of each map beside it.
        target: MCAP file to write; or
        directory: where map and pictures go under names of their own, unless they are there already.
    """

    path: Path
    fusion: FusionSection
    calibration: Path | None = None
    extras: Extras = Extras()  # noqa: RUF009 — frozen
    target: Path | None = None
    directory: Path | None = None


class FileResult(BaseModel):
    """What became of one recording."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    input: Shown = Field(description="The recording.")
    output: Shown | None = Field(None, description="The file with the maps, where one was wanted.")
    resumed: bool = Field(False, description="Whether it was there already, from an earlier run.")
    damage: Shown | None = Field(None, description="What of the recording cannot be read; None = nothing.")
    failures: tuple[Shown, ...] = Field((), description="Bursts that could not be fused, and why.")
    error: Shown | None = Field(None, description="Why it could not be fused; None = it was.")
    bursts: tuple[BurstSummary, ...] = Field((), description="Every fused burst.")

    @property
    def lost(self) -> tuple[str, ...]:
        """What of the recording is in no map."""
        return (() if self.damage is None else (self.damage,)) + self.failures


def fuse_file(
    task: FuseTask,
    announce: Announce = lambda _: None,
    heard: Callable[[BurstSummary], None] = lambda _: None,
    begun: Callable[[int], None] = lambda _: None,
) -> FileResult:
    """Fuse a recording burst after burst, unless that was done before.

    Args:
        task: what to fuse.
        announce: told of each burst before it is fused.
        heard: given each burst's summary.
        begun: told how many frames there are.

    Raises:
        DriverError: the recording cannot be read, or the result not written.
        ServiceError: the calibration or the directory cannot be used.
        FusionError: no burst can be fused.
    """
    target = task.target
    calibration = configured_calibration(CameraSection(calibration=task.calibration))
    if task.directory is not None:
        target = result_path(task.path, task.directory, task.fusion, task.extras, task.calibration)
        if (before := outcome_of(target)) is not None:
            return FileResult(
                input=str(task.path),
                output=str(target),
                resumed=True,
                damage=before.damage,
                failures=before.failures,
                bursts=before.bursts,
            )
    recording = open_recording(task.path)
    begun(recording.frame_count)
    damage = None if recording.damage is None else str(recording.damage)
    found: list[BurstSummary] = []
    failures: list[str] = []

    def finish(writer: RecordingWriter) -> None:
        attach_outcome(writer, Outcome(damage=damage, failures=tuple(failures), bursts=tuple(found)))

    with ExitStack() as stack:
        written = target
        if target is not None:
            stack.enter_context(made_directory(target.parent))
        if target is not None and task.directory is not None:
            written = stack.enter_context(working_file(target))
        pictures = None if task.directory is None or target is None else _Pictures(target)
        results = fuse_recording(
            recording, task.fusion, calibration, written, task.extras, announce, finish, failures.append
        )
        for result in results:
            burst = summarize(result, recording.truth)
            found.append(burst)
            heard(burst)
            if pictures is not None:
                write_preview(pictures.path_of(result), result, recording.truth, burst.errors)
    return FileResult(
        input=str(task.path),
        output=None if target is None else str(target),
        damage=damage,
        failures=tuple(failures),
        bursts=tuple(found),
    )


def attempted(task: FuseTask, announce: Announce = lambda _: None) -> FileResult:
    """As `fuse_file`, but whatever goes wrong is said in the result, for others to go on."""
    try:
        return fuse_file(task, announce)
    except (DriverError, ServiceError, FusionError) as error:
        return failed(task, str(error))
    except OSError as error:
        return failed(task, f"{error.filename or task.path}: {error.strerror or error}")
    except Exception as error:  # a fault of ours over one recording is none of the others'
        return failed(task, internal(error))


def failed(task: FuseTask, why: str) -> FileResult:
    """One line on it, which names the recording."""
    line, name = " ".join(why.split()), str(task.path)
    return FileResult(input=name, error=line if name in line else f"{name}: {line}")


class _Pictures:
    """Names for the pictures of one recording, of which two bursts may have one id.

    Pictures of an interrupted run of the same content and parameters are replaced.
    """

    def __init__(self, target: Path) -> None:
        self._stem = target.with_name(target.name.removesuffix("-fused.mcap"))
        self._bursts: dict[int, int] = {}

    def path_of(self, result: FusedMap) -> Path:
        burst = result.report.burst
        self._bursts[burst] = number = self._bursts.get(burst, 0) + 1
        again = f"-{number}" if number > 1 else ""
        return self._stem.with_name(f"{self._stem.name}-burst-{burst:04d}{again}.png")
