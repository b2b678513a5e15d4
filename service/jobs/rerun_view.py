"""Recordings and running rigs in Rerun, by its own reader of MCAP: what is shown live is what is recorded."""

import socket
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryFile
from threading import Condition
from typing import IO

import zenoh
from mcap.writer import CompressionType, Writer

from drivers.messages import CAMERA_AMPLITUDE, CAMERA_CALIBRATION, STAGE_TRANSFORM
from service.errors import RemoteError, ServiceError
from service.jobs.rerun_blueprint import blueprint, rerun
from service.messages.schemas import topic_schemas
from service.messages.topics import (
    FUSED_CALIBRATION,
    FUSED_DEPTH_MM,
    FUSED_REPORT,
    FUSED_TRANSFORM,
    LOG,
    STATUS,
    TOPICS,
)
from service.wire.session import open_session

_START = 60.0
"""Seconds that the viewer may take until it listens."""

_LOADING = 120.0
"""Seconds that it may take to show what it was given."""

_ANSWER = 2.0
"""Seconds for the latest of one topic."""

_BEAT = 0.25
"""Seconds of messages that are handed over together."""

_MOST = 400
"""Messages that wait; the oldest go."""

_LIVE = (
    CAMERA_AMPLITUDE,
    CAMERA_CALIBRATION,
    STAGE_TRANSFORM,
    FUSED_CALIBRATION,
    FUSED_TRANSFORM,
    FUSED_DEPTH_MM,
    FUSED_REPORT,
    STATUS,
    LOG,
)
"""What is shown live: of a map the depth in millimetres alone, for all of it is eight times as much."""

Sample = tuple[str, bytes, int]
"""Topic, payload, and when it came, ns since the epoch."""


class Viewer:
    """A Rerun viewer of this program's own, on loopback.

    Args:
        process: the viewer.
        port: where it listens.
    """

    def __init__(self, process: "subprocess.Popen[bytes]", port: int) -> None:
        self._process = process
        self._url = f"rerun+http://127.0.0.1:{port}/proxy"
        self._shown = rerun().RecordingStream("lidarboost")
        self._shown.connect_grpc(self._url)
        self._shown.send_blueprint(blueprint())

    @property
    def is_open(self) -> bool:
        """Whether nobody has closed it yet."""
        return self._process.poll() is None

    def close(self) -> None:
        """Let go of it, while it listens yet."""
        self._shown.disconnect()

    def wait(self) -> None:
        """Until it is closed."""
        self._process.wait()

    def show(self, path: Path) -> None:
        """Show a recording."""
        self._shown.log_file_from_path(path)

    def show_messages(self, samples: Sequence[Sample]) -> None:
        """Show messages that just came."""
        self._shown.log_file_from_contents("live.mcap", mcap_of(samples))

    def save_picture(self, path: Path) -> None:
        """Save what it shows as PNG, once it has loaded all of it.

        Raises:
            ServiceError: it does not get ready in time.
        """
        from rerun.experimental import ViewerClient

        self._shown.flush()
        client = ViewerClient.connect(self._url)
        deadline = time.monotonic() + _LOADING
        while (state := client.get_state()).loading or not any(r.timelines for r in state.recordings):
            if time.monotonic() > deadline:
                raise ServiceError(f"the viewer did not load everything within {_LOADING:g} s")
            time.sleep(_BEAT)
        client.save_screenshot(str(path.resolve()))


@contextmanager
def viewer(*, headless: bool = False) -> Iterator[Viewer]:
    """A viewer that listens on loopback alone (of itself it would on every address), ended in the end.

    Raises:
        ConfigurationError: Rerun is not installed.
        ServiceError: it does not start.
    """
    rerun()
    import rerun_cli

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [str(Path(rerun_cli.__file__).with_name("rerun")), "--bind", "127.0.0.1", "--port", str(port)]
    command += ["--hide-welcome-screen", *(["--headless"] if headless else ["--expect-data-soon"])]
    with ExitStack() as stack:
        said = stack.enter_context(TemporaryFile())
        process = subprocess.Popen(command, stdout=said, stderr=said)
        stack.callback(process.wait)
        stack.callback(process.terminate)
        _await(process, port, said)
        shown = Viewer(process, port)
        stack.callback(shown.close)
        yield shown


def show_live(shown: Viewer, endpoint: str, prefix: str, timeout: float, *, maps: int | None = None) -> None:
    """Show what a rig publishes until the viewer is closed, or so many maps have come.

    Raises:
        RemoteError: nothing came within `timeout` seconds.
        SessionError: the endpoint is none.
    """
    with ExitStack() as stack:
        session = stack.enter_context(open_session(listen=(), connect=(endpoint,)))
        arrived = _Arrived(prefix)
        for topic in _LIVE:
            subscriber = session.declare_subscriber(f"{prefix}/{topic}", arrived.take)
            stack.callback(subscriber.undeclare)
        _ask_latest(session, prefix, arrived, timeout)
        seen = 0
        while shown.is_open and (maps is None or seen < maps):
            samples = arrived.wait(_BEAT)
            if samples:
                shown.show_messages(samples)
                seen += sum(topic == FUSED_DEPTH_MM for topic, _, _ in samples)


def mcap_of(samples: Sequence[Sample]) -> bytes:
    """An MCAP file of messages."""
    stream, schemas = BytesIO(), topic_schemas()
    writer = Writer(stream, compression=CompressionType.NONE)
    writer.start()
    channels: dict[str, int] = {}
    for topic, payload, at in samples:
        if topic not in channels:
            schema = schemas[topic]
            number = writer.register_schema(schema.name, schema.encoding, schema.data)
            kind = "protobuf" if schema.encoding == "protobuf" else "json"
            channels[topic] = writer.register_channel(f"/{topic}", kind, number)
        writer.add_message(channels[topic], at, payload, at)
    writer.finish()  # type: ignore[no-untyped-call]
    return stream.getvalue()


class _Arrived:
    """Messages that came and were not shown yet."""

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self._changed = Condition()
        self._samples: list[Sample] = []

    def take(self, sample: zenoh.Sample) -> None:
        topic = str(sample.key_expr).removeprefix(f"{self._prefix}/")
        with self._changed:
            self._samples.append((topic, sample.payload.to_bytes(), time.time_ns()))
            del self._samples[:-_MOST]
            self._changed.notify_all()

    def wait(self, seconds: float) -> list[Sample]:
        """What came within some seconds."""
        time.sleep(seconds)
        with self._changed:
            samples, self._samples = self._samples, []
            return samples


def _ask_latest(session: zenoh.Session, prefix: str, arrived: _Arrived, timeout: float) -> None:
    """Have the latest of every topic, as soon as a rig answers."""
    deadline, found = time.monotonic() + timeout, False
    while not found:
        if time.monotonic() > deadline:
            raise RemoteError(
                f"no service of prefix {prefix!r} answered within {timeout:g} s; start one with "
                "`lidarboost run`, or name its endpoint and prefix"
            )
        for topic in _LIVE:
            if TOPICS[topic].latest:
                for reply in session.get(f"{prefix}/{topic}", timeout=_ANSWER):
                    if reply.ok is not None:
                        arrived.take(reply.ok)
                        found = True


def _await(process: "subprocess.Popen[bytes]", port: int, told: IO[bytes]) -> None:
    deadline = time.monotonic() + _START
    while time.monotonic() < deadline:
        if process.poll() is not None:
            told.seek(0)
            said = told.read().decode(errors="replace").splitlines()
            last = next((line for line in reversed(said) if line.strip()), "it said nothing")
            raise ServiceError(f"the viewer ended at once: {last}")
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    raise ServiceError(f"the viewer did not listen within {_START:g} s")
