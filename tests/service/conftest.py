import json
import os
import socket
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jobs_to_fuse import SETTINGS
from scripted import frame
from typed import write

from drivers import Frame, sr3000_calibration
from service.config.sections import FusionSection
from service.fusion.fuse import fuse_burst
from service.fusion.local import LocalExecutor
from service.messages.burst import Burst
from service.messages.map import FusedMap

NOISE, SHAPE = 0.01, (36, 44)


@pytest.fixture(scope="session")
def free_endpoint() -> Callable[[], str]:
    """Loopback endpoints that are free."""

    def find() -> str:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            return f"tcp/127.0.0.1:{probe.getsockname()[1]}"

    return find


@pytest.fixture
def endpoint(free_endpoint: Callable[[], str]) -> str:
    """One of them."""
    return free_endpoint()


@pytest.fixture
def typing_settings(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory, endpoint: str
) -> None:
    """A port of its own, and the fastest method: what is tested of commands is not the fusion."""
    for name in os.environ:
        if name.startswith("LIDARBOOST_"):
            monkeypatch.delenv(name)
    zenoh = tmp_path_factory.mktemp("typed") / "zenoh.json5"
    zenoh.write_text(json.dumps({"listen": {"endpoints": [endpoint]}}))
    monkeypatch.setenv("LIDARBOOST_ZENOH__CONFIG", str(zenoh))
    monkeypatch.setenv("LIDARBOOST_FUSION__METHOD", "nearest")
    monkeypatch.setenv("LIDARBOOST_FUSION__REGISTER_POSES", "false")


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Three bursts of four tiny frames."""
    frames = [frame(k, 10**18 + k * 10**8, burst=k // 4, pose=k % 4) for k in range(12)]
    return write(tmp_path / "small.mcap", frames)


@pytest.fixture(scope="session")
def _fused() -> FusedMap:
    """A wall at 2 m with a hole that nothing was seen in, fused from three still frames."""
    nominal = sr3000_calibration()
    centre = {"cx": (SHAPE[1] - 1) / 2, "cy": (SHAPE[0] - 1) / 2}
    calibration = nominal.model_copy(
        update={
            "height": SHAPE[0],
            "width": SHAPE[1],
            "intrinsics": nominal.intrinsics.model_copy(update=centre),
        }
    )
    rng = np.random.default_rng(5)
    frames = []
    for number in range(3):
        metres = 2.0 + rng.normal(0, NOISE, SHAPE)
        counts = np.round(metres / 7.5 * 65536).astype(np.uint16)
        counts[:12, :12] = 0
        amplitude = np.full(SHAPE, 3000, np.uint16)
        at = 1_700_000_000_123_456_789 + number * 200_000_000
        frames.append(Frame(counts, amplitude, at, number + 7, 0.0, 0.0, 0.030, 20e6, 7.5))
    burst = Burst(4, tuple(frames), calibration, 3)
    settings = FusionSection(method="nearest", upsampling=2, register_poses=False, fill=2)
    return fuse_burst(burst, settings)


@pytest.fixture
def fused(_fused: FusedMap) -> Callable[[int], FusedMap]:
    """Fused maps that differ in their time and burst number."""

    def numbered(number: int) -> FusedMap:
        at = _fused.frame.timestamp + number * 1_000_000_000
        return replace(
            _fused,
            frame=replace(_fused.frame, timestamp=at, sequence=number),
            report=_fused.report.model_copy(update={"burst": number, "timestamp": at}),
        )

    return numbered


@pytest.fixture(scope="module")
def started() -> Iterator[LocalExecutor]:
    """An executor on this machine that is ready."""
    executor = LocalExecutor(SETTINGS)
    executor.ready.result(60)
    yield executor
    executor.close()
