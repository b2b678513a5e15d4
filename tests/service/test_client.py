import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from publishing import publishing

from drivers import Frame, sr3000_calibration
from drivers.messages import calibration_message, frame_messages
from service.errors import RemoteError, SessionError
from service.messages.decoding import Received, decode
from service.messages.encoding import fused_messages
from service.messages.events import MapFused
from service.messages.map import FusedMap
from service.wire.client import Client
from service.wire.session import open_session
from service.wire.subscription import Subscription

WEDGES = Path(__file__).parents[2] / "recordings" / "wedges.mcap"


def test_latest_depth_comes_with_its_intrinsics(endpoint: str, fused: Callable[[int], FusedMap]) -> None:
    result = fused(2)
    with open_session([endpoint]) as session, publishing(session) as publisher, Client(endpoint) as client:
        publisher.publish(fused_messages(fused(1)))
        publisher.take(MapFused(result, None))
        assert publisher.drain()
        depth = client.latest("fused/depth")
        np.testing.assert_array_equal(depth.value, result.depth)
        assert depth.value.dtype == np.float32
        assert depth.timestamp == result.frame.timestamp
        assert depth.intrinsics is not None
        np.testing.assert_allclose(depth.intrinsics, result.intrinsics)
        assert depth.distortion is not None
        assert not depth.distortion.any()
        assert client.latest("fused/report").value["burst"] == 2
        points = client.latest("fused/points").value
        assert points.dtype.names == ("x", "y", "z", "amplitude", "deviation")
        np.testing.assert_allclose(points["z"], result.depth[np.isfinite(result.depth)], rtol=1e-6)


def test_a_client_may_be_there_before_the_service(endpoint: str, fused: Callable[[int], FusedMap]) -> None:
    with ExitStack() as stack:
        client = stack.enter_context(Client(endpoint))
        reports = stack.enter_context(client.subscribe("fused/report"))
        session = stack.enter_context(open_session([endpoint]))
        stack.enter_context(publishing(session)).publish(fused_messages(fused(7)))
        assert reports.receive(timeout=20).value["burst"] == 7


def test_subscribers_get_the_latest_first_and_then_what_comes(
    endpoint: str, fused: Callable[[int], FusedMap]
) -> None:
    with open_session([endpoint]) as session, publishing(session) as publisher, Client(endpoint) as client:
        publisher.publish(fused_messages(fused(1)))
        assert publisher.drain()
        with client.subscribe("fused/report") as reports:
            assert reports.receive().value["burst"] == 1
            for number in (2, 3, 4):
                publisher.publish(fused_messages(fused(number)))
            assert [reports.receive().value["burst"] for _ in range(3)] == [2, 3, 4]
        with pytest.raises(RemoteError, match="subscription is closed"):
            reports.receive()


def test_a_handler_is_called_with_each_message_and_one_that_fails_is_called_again(
    endpoint: str, fused: Callable[[int], FusedMap], caplog: pytest.LogCaptureFixture
) -> None:
    bursts: list[int] = []

    def handle(report: Received) -> None:
        bursts.append(report.value["burst"])
        if report.value["burst"] == 1:
            raise ValueError("not this one")

    with open_session([endpoint]) as session, publishing(session) as publisher, Client(endpoint) as client:
        publisher.publish(fused_messages(fused(1)))
        assert publisher.drain()
        client.subscribe("fused/report", handle)
        deadline = time.monotonic() + 20
        for number in (1, 2, 3):
            # What is published before the former message has been handled may take its place.
            if number > 1:
                publisher.publish(fused_messages(fused(number)))
            while not bursts or bursts[-1] != number:
                assert time.monotonic() < deadline
                time.sleep(0.005)
    assert bursts[0] == 1
    assert "the handler of fused/report failed" in caplog.text


def test_a_slow_reader_of_images_gets_the_newest(
    endpoint: str, fused: Callable[[int], FusedMap], monkeypatch: pytest.MonkeyPatch
) -> None:
    newest = [fused(number).frame.timestamp for number in (28, 29)]
    take, arrived = Subscription._arrived, threading.Event()

    def watched(subscription: Subscription, sample: zenoh.Sample) -> None:
        take(subscription, sample)
        image = decode(str(sample.key_expr), str(sample.encoding), sample.payload.to_bytes())
        if image.timestamp == newest[-1]:
            arrived.set()

    monkeypatch.setattr(Subscription, "_arrived", watched)
    with open_session([endpoint]) as session, publishing(session) as publisher, Client(endpoint) as client:
        publisher.publish(fused_messages(fused(1)))
        assert publisher.drain()
        with client.subscribe("fused/depth") as images:
            assert images.receive().timestamp == fused(1).frame.timestamp
            for number in range(2, 30):
                publisher.publish(fused_messages(fused(number)))
            assert arrived.wait(20)
            assert [images.receive().timestamp for _ in range(2)] == newest


def test_raw_frames_come_with_the_cameras_calibration(endpoint: str) -> None:
    calibration = sr3000_calibration()
    counts = np.arange(144 * 176, dtype=np.uint16).reshape(144, 176)
    frame = Frame(counts, counts, 1_700_000_000_000_000_000, 3, 0.0, 0.0, 0.03, 20e6, 7.5)
    with open_session([endpoint]) as session, publishing(session) as publisher, Client(endpoint) as client:
        publisher.publish([calibration_message(calibration, frame.timestamp)])
        with client.subscribe("camera/distance") as images:
            deadline = time.monotonic() + 20
            while True:
                publisher.publish(frame_messages(frame, calibration.mount))
                try:
                    image = images.receive(timeout=0.1)
                    break
                except RemoteError:
                    assert time.monotonic() < deadline
        np.testing.assert_array_equal(image.value, counts)
        assert image.intrinsics is not None
        np.testing.assert_allclose(image.intrinsics, calibration.intrinsics.matrix)


def test_errors_say_what_is_missing(endpoint: str) -> None:
    with Client(endpoint) as client:
        with pytest.raises(RemoteError, match=rf"no service answered at {endpoint} .*lidarboost run"):
            client.latest("fused/depth", timeout=0.1)
        with pytest.raises(RemoteError, match=r"no topic is called 'fused/dept'; there are: .*fused/depth"):
            client.latest("fused/dept")
        with pytest.raises(RemoteError, match="no topic is called 'cmd/scan'"):
            client.subscribe("cmd/scan")
        with open_session([endpoint]) as session, publishing(session):
            while True:
                with pytest.raises(RemoteError) as caught:
                    client.latest("fused/depth", timeout=0.3)
                if "had no value" in str(caught.value):
                    break
    with pytest.raises(SessionError, match="nonsense"):
        Client("nonsense")


@pytest.mark.parametrize(
    ("encoding", "payload"),
    [
        ("application/protobuf;foxglove.RawImage", b"\xff\xff"),
        ("application/protobuf;foxglove.Nothing", b""),
        ("application/protobuf;ros.Image", b""),
        ("application/json;lidarboost.Status", b"{"),
    ],
)
def test_what_cannot_be_read_is_refused_by_name(encoding: str, payload: bytes) -> None:
    with pytest.raises(RemoteError, match=f"fused/depth: cannot read what came as '{encoding}'"):
        decode("fused/depth", encoding, payload)


def test_importing_the_package_is_light() -> None:
    heavy = ("numpy", "zenoh", "numba", "pydantic")
    script = f"import sys, lidarboost; print([name for name in {heavy} if name in sys.modules])"
    out = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_everything_public_is_there() -> None:
    import lidarboost

    assert {lidarboost.fuse.__name__, lidarboost.Client.__name__} == {"fuse", "Client"}
    for name in lidarboost.__all__:
        assert getattr(lidarboost, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'fusion'"):
        lidarboost.fusion  # noqa: B018


@pytest.mark.parametrize(
    "options", [{"name": "auto", "recording": WEDGES}, {"name": "replay", "path": WEDGES}]
)
def test_a_camera_is_opened_by_name_or_found(
    options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    import lidarboost
    from drivers.auto import AutoCamera

    # No look for real cameras: whether one is connected here is not the question.
    monkeypatch.setattr(AutoCamera, "_open_real", lambda _: None)
    with lidarboost.open_camera(**options) as camera:
        assert camera.capabilities.source == "replay"
        camera.start()
        assert camera.grab().shape == (144, 176)
