"""A service at work in a thread, and strangers in other processes who command it."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any

from service.capture.rig import Rig
from service.config.file import load
from service.config.sections import Configuration
from service.daemon.daemon import Daemon
from service.daemon.run import run_service
from service.messages.events import Event
from service.messages.summary import RunSummary
from service.sinks.sink import Sink

STRANGER = Path(__file__).with_name("stranger.py")
FUSION = {"method": "nearest", "upsampling": 2, "register_poses": False, "frames": 4}


def configuration(folder: Path, endpoint: str, **sections: Any) -> Configuration:
    """A service that listens on `endpoint` and, unless told otherwise, is idle first."""
    zenoh = folder / "zenoh.json5"
    zenoh.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))
    sections["fusion"] = {**FUSION, **sections.get("fusion", {})}
    return load(None, {"zenoh": {"config": str(zenoh)}, "start": "idle", **sections})


class Keeper(Sink):
    """Keeps every event."""

    def __init__(self, events: list[Event]) -> None:
        super().__init__()
        self.events = events

    def take(self, event: Event) -> None:
        self.events.append(event)


class Running:
    """A service in a thread.

    Attributes:
        daemon: at work.
        events: all so far.
        summary: once it is over.
    """

    def __init__(self, settings: Configuration, rig: Rig) -> None:
        self.settings, self.rig = settings, rig
        self.events: list[Event] = []
        self.summary: RunSummary | None = None
        self.error: BaseException | None = None
        self.daemon: Daemon | None = None
        self.thread = Thread(target=self._run, daemon=True)

    def wait(self, true: Callable[[], bool], seconds: float = 60.0) -> None:
        """Until it is true."""
        end = time.monotonic() + seconds
        while not true():
            assert time.monotonic() < end, "not so in time"
            assert self.error is None, self.error
            time.sleep(0.005)

    def wait_state(self, state: str) -> None:
        self.wait(lambda: self.daemon is not None and self.daemon.states.state == state)

    def of(self, kind: type[Event]) -> list[Any]:
        """The events of a kind so far."""
        return [event for event in list(self.events) if isinstance(event, kind)]

    def _run(self) -> None:
        try:
            self.summary = run_service(
                self.settings,
                self.rig,
                sinks={"test": lambda: Keeper(self.events)},
                started=lambda daemon: setattr(self, "daemon", daemon),
            )
        except BaseException as error:
            self.error = error


@contextmanager
def running(settings: Configuration, rig: Rig, state: str = "idle") -> Iterator[Running]:
    """A service that has come to a state; it is stopped in the end, which may take five seconds."""
    service = Running(settings, rig)
    service.thread.start()
    try:
        service.wait_state(state)
        yield service
    finally:
        if service.daemon is not None:
            service.daemon.stop.set()
        service.thread.join(20)
        assert not service.thread.is_alive()


class Stranger:
    """A program in another process that knows nothing but Zenoh and JSON."""

    def __init__(self, endpoint: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(STRANGER), endpoint],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "connected\n"
        self.seconds = 0.0

    def query(self, key: str, **query: Any) -> list[dict[str, Any]]:
        """All replies to a query; `payload` is text."""
        self.send(key, **query)
        return self.replies()

    def ask(self, name: str, **request: Any) -> dict[str, Any]:
        """The one reply to a command, or its `{"code", "message"}`."""
        [reply] = self.query(f"lidarboost/rig/{name}", payload=json.dumps(request))
        answer: dict[str, Any] = reply["ok"] if "ok" in reply else reply["error"]
        return answer

    def send(self, key: str, **query: Any) -> None:
        assert self.process.stdin is not None
        print(json.dumps({"key": key, **query}), file=self.process.stdin, flush=True)

    def replies(self) -> list[dict[str, Any]]:
        assert self.process.stdout is not None
        told = json.loads(self.process.stdout.readline())
        self.seconds = told["seconds"]
        replies: list[dict[str, Any]] = told["replies"]
        return replies

    def close(self) -> None:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        self.process.wait(20)
        self.process.stdout.close()


@contextmanager
def stranger(endpoint: str) -> Iterator[Stranger]:
    program = Stranger(endpoint)
    try:
        yield program
    finally:
        program.close()
