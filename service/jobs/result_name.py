"""Results named by what they were made of, so that nothing is done twice and nothing half done counts."""

import hashlib
import json
import re
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from glob import escape
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.errors import RecordingError
from drivers.names import Shown
from drivers.recording import RecordingWriter, open_recording
from drivers.recording.locks import is_used
from drivers.recording.output import WORKING_SUFFIX
from service.config.sections import FusionSection
from service.errors import OutputError
from service.messages.summary import BurstSummary
from service.messages.viewing import Extras
from service.versions import software_version

_SIX_BYTES = 6
"""Of the digest: two of a million results have one name with a chance of 2e-3, and then of other stems."""

_RESULT = re.compile(r".*-[0-9a-f]{12}-fused(\.[0-9a-f]{8}\.partial)?\.mcap")

_NO_MATTER = {"backlog", "timeout", "executor", "cluster"}
"""Settings of the fusion that change no map."""

_OUTCOME = "outcome"


class Outcome(BaseModel):
    """What is said of a fused recording; attached to the result."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    damage: Shown | None = Field(description="What of the input could not be read.")
    failures: tuple[Shown, ...] = Field((), description="Bursts that could not be fused, and why.")
    bursts: tuple[BurstSummary, ...] = Field(description="Every fused burst.")


def recordings_among(inputs: Iterable[Path]) -> list[Path]:
    """Files as they are given, and of each folder every recording below it but such results, by name.

    Raises:
        RecordingError: a folder without any.
    """
    found: list[Path] = []
    for path in inputs:
        if not path.is_dir():
            found.append(path)
            continue
        inside = sorted(p for p in path.rglob("*.mcap") if p.is_file() and not _RESULT.fullmatch(p.name))
        if not inside:
            raise RecordingError(f"{path}: the folder holds no recording (*.mcap); name another one")
        found += inside
    return list(dict.fromkeys(found))


def result_path(
    path: Path, directory: Path, fusion: FusionSection, extras: Extras, calibration: Path | None = None
) -> Path:
    """`NAME-DIGEST-fused.mcap`: of the recording's content, what decides the maps, and this version.

    Raises:
        RecordingError: the recording cannot be read.
    """
    said = [
        software_version(),
        fusion.model_dump(mode="json", exclude=_NO_MATTER),
        asdict(extras),
    ]
    digest = hashlib.blake2b(json.dumps(said, sort_keys=True).encode(), digest_size=_SIX_BYTES)
    for read in (path, calibration):
        digest.update(b"-" if read is None else _digest_of(read))
    return directory / f"{path.stem}-{digest.hexdigest()}-fused.mcap"


def _digest_of(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "blake2b").digest()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error


def attach_outcome(writer: RecordingWriter, outcome: Outcome) -> None:
    """Have a result say what it holds."""
    writer.attach(_OUTCOME, outcome.model_dump_json().encode(), "application/json")


def outcome_of(path: Path) -> Outcome | None:
    """What a result says of itself; None where there is none, or none that is whole."""
    if not path.exists():
        return None
    try:
        result = open_recording(path)
        said = None if result.damage is not None else result.attachment(_OUTCOME)
        return None if said is None else Outcome.model_validate_json(said)
    except (RecordingError, ValidationError, OSError):
        return None


@contextmanager
def working_file(path: Path) -> Iterator[Path]:
    """Where to write a result that shall be whole or not at all: it gets its name once all went well.

    The working name is nobody else's: a cluster may do a thing twice at a time. What processes that died
    have left behind goes.

    Raises:
        OutputError: it cannot get its name.
    """
    for left in path.parent.glob(f"{escape(path.stem)}.*.partial.mcap{WORKING_SUFFIX}"):
        with suppress(OSError):
            if is_used(left) is False:
                left.unlink()
    partial = path.with_name(f"{path.stem}.{uuid.uuid4().hex[:8]}.partial.mcap")
    try:
        yield partial
        try:
            partial.replace(path)
        except OSError as error:
            raise OutputError(
                f"{path}: cannot be written ({error.strerror}); choose another place"
            ) from error
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
