"""The commands about recordings as methods; each returns the reply's fields and raises a `CommandError`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from service.errors import RemoteError
from service.files import whole_file
from service.wire.asking import Answer
from service.wire.verbs import Ask

_PART = 2_000_000
"""Bytes that are fetched at a time: some tenths of a second on a slow link."""


class Record:
    """Recordings in the service's folder."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    def start(self, timeout: float = 30.0, *, maps: bool | None = None, replays: bool = False) -> Answer:
        """Begin to record.

        Args:
            timeout: seconds.
            maps: fused maps too, not frames alone; None = as configured.
            replays: also what is played from a recording.
        """
        return self._ask("cmd/record", "start", timeout, maps=maps, replays=replays)

    def stop(self, timeout: float = 30.0) -> Answer:
        """End the recording; returns once the file is complete."""
        return self._ask("cmd/record", "stop", timeout)

    def keep(self, file: str | None = None, timeout: float = 10.0, *, keep: bool = True) -> Answer:
        """Never delete a recording to make room, or do so again; None = the one at work, or the last."""
        return self._ask("cmd/record", "keep", timeout, file=file, keep=keep)

    def list(self, timeout: float = 30.0, *, count: int = 100) -> Answer:
        """At most `count` of the `recordings` there are, newest first."""
        return self._ask("cmd/record", "list", timeout, count=count)

    def fetch(
        self,
        file: str,
        target: str | Path,
        timeout: float = 30.0,
        progress: Callable[[int, int], None] = lambda _, __: None,
    ) -> Path:
        """Copy a recording from the service to here, whole or not at all.

        Args:
            file: its name there.
            target: where it goes; a folder that exists = under its own name in there.
            timeout: seconds for each part of it.
            progress: told how many bytes are here, of how many.

        Raises:
            RemoteError: no answer, or the file became another meanwhile.
            OutputError: it cannot be written here.
        """
        target = fetched_to(file, target)
        with whole_file(target) as partial, partial.open("wb") as output:
            size = None
            while size is None or output.tell() < size:
                answer = self.part(file, output.tell(), timeout, _PART)
                told, content = answer["part"], answer.messages[file].value
                if (size is not None and told["total"] != size) or len(content) != told["size"]:
                    raise RemoteError(f"{file}: has changed while it was fetched; fetch it again")
                size = int(told["total"])
                output.write(content)
                progress(output.tell(), size)
                if not content:
                    break
        return target

    def part(self, file: str, offset: int, timeout: float = 30.0, size: int = _PART) -> Answer:
        """At most `size` bytes from `offset` on; `Answer.messages[file].value` are they."""
        return self._ask("cmd/record", "fetch", timeout, file=file, offset=offset, size=size)

    def recover(self, file: str, timeout: float = 600.0) -> Answer:
        """Make a whole recording of what a torn one holds, there."""
        return self._ask("cmd/record", "recover", timeout, file=file)


def fetched_to(file: str, target: str | Path) -> Path:
    """Where a recording goes: into a folder under its own name."""
    path = Path(target)
    return path / Path(file).name if path.is_dir() else path


class Replay:
    """A recording that stands for the camera."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask

    def load(
        self,
        file: str,
        timeout: float = 300.0,
        *,
        mode: str = "scan",
        play: bool = False,
        speed: float | None = 1.0,
        loop: bool = False,
    ) -> Answer:
        """Open a recording of the service's folder in place of the camera.

        Args:
            file: its name there.
            timeout: seconds.
            mode: `scan`, a map of each burst, or `stream`, one of the last frames with every frame.
            play: go on by itself at once.
            speed: times real time; None = as fast as it can be fused.
            loop: begin again at the end.
        """
        return self._ask(
            "cmd/replay", "load", timeout, file=file, mode=mode, play=play, speed=speed, loop=loop
        )

    def play(self, timeout: float = 10.0) -> Answer:
        """Go on."""
        return self._ask("cmd/replay", "play", timeout)

    def pause(self, timeout: float = 10.0) -> Answer:
        """Stand still."""
        return self._ask("cmd/replay", "pause", timeout)

    def step(self, count: int = 1, timeout: float = 300.0, *, unit: str | None = None) -> Answer:
        """Play so many `unit`s, burst or frame (None = what gives a map), and stand still."""
        return self._ask("cmd/replay", "step", timeout, count=count, unit=unit)

    def seek(
        self,
        seconds: float | None = None,
        timeout: float = 10.0,
        *,
        burst: int | None = None,
        frame: int | None = None,
    ) -> Answer:
        """Go to a second, a burst or a frame (from 0): one of them."""
        place: dict[str, Any] = {"seconds": seconds, "burst": burst, "frame": frame}
        return self._ask("cmd/replay", "seek", timeout, **place)

    def speed(self, speed: float | None, timeout: float = 10.0) -> Answer:
        """Play so many times as fast as real time; None = as fast as it can be fused."""
        return self._ask("cmd/replay", "speed", timeout, speed=speed)

    def loop(self, loop: bool, timeout: float = 10.0) -> Answer:
        """Begin again at the end, or not."""
        return self._ask("cmd/replay", "loop", timeout, loop=loop)

    def stop(self, timeout: float = 60.0) -> Answer:
        """End the replay; the service is idle then."""
        return self._ask("cmd/replay", "stop", timeout)

    def get(self, timeout: float = 10.0) -> Answer:
        """Where it is."""
        return self._ask("cmd/replay", "get", timeout)
