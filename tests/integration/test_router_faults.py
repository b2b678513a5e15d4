"""A router that is killed, stopped and started again: survived, told, and mended within seconds."""

import signal
import time
from pathlib import Path

import pytest
from daemons import PREFIX, daemon, ear, free_port, router, wait_until

pytestmark = pytest.mark.faults

GAP, STOP, BACK = 4.5, 9.0, 10.0
"""Seconds, wide enough for a busy machine: a stuck link that others wait for costs 5, and at the end 10."""

DEPLOY = Path(__file__).parents[2] / "deploy"


def deployed(name: str, endpoint: str, instead: str) -> str:
    text = (DEPLOY / name).read_text(encoding="utf-8")
    assert endpoint in text
    return text.replace(endpoint, instead)


def test_a_router_may_come_late_be_killed_and_hang(tmp_path: Path) -> None:
    at = f"tcp/127.0.0.1:{free_port()}"
    file = tmp_path / "router.json5"
    file.write_text(deployed("zenoh-router.json5", "tcp/0.0.0.0:7447", at), encoding="utf-8")
    rig, prefix = deployed("zenoh-rig.json5", "tcp/127.0.0.1:7448", at), f"bench/{PREFIX}"
    with daemon(tmp_path, rig) as service, ear(service.endpoint, prefix) as near, ear(at, prefix) as far:

        def degraded() -> bool:
            return any(at in fault["what"] for fault in near.status["degraded"])

        near.hears("status", more=2)
        assert degraded()
        with router(file):
            assert far.hears("fused/depth", more=1) < 60
            wait_until(lambda: not degraded(), 10, "connected")
        wait_until(degraded, 10, "the router is gone")
        near.hears("fused/depth")
        with router(file) as process:
            assert far.hears("fused/depth", more=1) < BACK, "after the router returned"
            wait_until(lambda: not degraded(), BACK, "connected again")
            process.send_signal(signal.SIGSTOP)
            since = time.monotonic()
            wait_until(degraded, 20, "the router hangs")
            assert near.longest_gap("camera/distance", since) < GAP
            assert near.longest_gap("status", since) < GAP
            process.send_signal(signal.SIGCONT)
            assert far.hears("fused/depth", more=1) < BACK, "after the router went on"
            wait_until(lambda: not degraded(), BACK, "connected again")
            process.send_signal(signal.SIGSTOP)
            near.hears("fused/depth", more=10)
            assert service.stop() < STOP, service.log
    assert f"the connection to {at} is lost" in service.log
    assert service.log.count(f"connected to {at} after") >= 3
