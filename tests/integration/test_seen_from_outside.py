"""A service that runs, as the machine it runs on sees it: sockets, health, log, and what it never says."""

import ipaddress
import json
import os
import struct
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from daemons import PREFIX, daemon, ear, free_port, wait_until

pytestmark = pytest.mark.slow

SECRET = "hunter2-4711"
TABLES = ("tcp", "tcp6", "udp", "udp6")


def processes(pid: int) -> Iterator[int]:
    """A process and all that it has started."""
    yield pid
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text(encoding="ascii").split():
            yield from processes(int(child))


def sockets_of(pid: int) -> set[str]:
    found = set()
    for link in Path(f"/proc/{pid}/fd").iterdir():
        try:
            found.add(str(link.readlink()).removeprefix("socket:[").removesuffix("]"))
        except OSError:  # closed meanwhile
            continue
    return found


def address(text: str) -> "ipaddress.IPv4Address | ipaddress.IPv6Address":
    """As the kernel prints it: words of four bytes, each in the machine's own order."""
    words = [int(text[k : k + 8], 16) for k in range(0, len(text), 8)]
    return ipaddress.ip_address(b"".join(struct.pack("=I", word) for word in words))


def bound(pid: int) -> list[tuple[str, "ipaddress.IPv4Address | ipaddress.IPv6Address", int]]:
    """Table, address and port of every socket of a process tree that takes what comes from elsewhere."""
    inodes = {inode for one in processes(pid) for inode in sockets_of(one)}
    found = []
    for table in TABLES:
        for line in Path(f"/proc/{pid}/net/{table}").read_text(encoding="ascii").splitlines()[1:]:
            fields = line.split()
            place, _, port = fields[1].partition(":")
            waits = fields[3] == "0A" if table.startswith("tcp") else True
            if fields[9] in inodes and waits:
                found.append((table, address(place), int(port, 16)))
    return found


def page(port: int, path: str) -> tuple[int, str]:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=10) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def test_addresses_are_read_as_the_kernel_prints_them() -> None:
    assert address("0100007F") == ipaddress.ip_address("127.0.0.1")
    assert address("00000000000000000000000001000000") == ipaddress.ip_address("::1")
    assert not address("00000000").is_loopback
    assert not address("0" * 32).is_loopback


def test_it_listens_on_loopback_alone_is_healthy_and_keeps_its_secrets(tmp_path: Path) -> None:
    port, folder = free_port(), tmp_path / "recordings"
    configuration = f"""
[metrics]
enabled = true
port = {port}
[log]
format = "json"
[recording]
enabled = true
directory = "{folder}"
[sinks.quiet]
kind = "quiet_sink:Quiet"
options = {{ password = "{SECRET}" }}
"""
    search = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    with daemon(tmp_path, "{}", configuration, {"PYTHONPATH": search}) as service:
        wait_until(lambda: '"logger"' in service.log or service.process.poll() is not None, 120, "a log")
        with ear(service.endpoint, PREFIX) as one:
            one.hears("fused/depth")
            listening = bound(service.process.pid)
            assert {(table, number) for table, _, number in listening} == {
                ("tcp", port),
                ("tcp", int(service.endpoint.rpartition(":")[2])),
            }
            assert all(place.is_loopback for _, place, _ in listening)
            assert page(port, "/healthz")[0] == 200
            wait_until(lambda: page(port, "/readyz")[0] == 200, 30, "ready")
            assert "lidarboost_maps_total" in page(port, "/metrics")[1]
            said = json.dumps(one.status)
        service.stop()
    lines = [line for line in service.log.splitlines() if line.startswith("{")]
    assert {"time", "level", "logger", "message"} <= json.loads(lines[0]).keys()
    assert any(json.loads(line)["logger"] == "service.fusion.local" for line in lines)
    recordings = list(folder.glob("*.mcap"))
    assert recordings
    texts = [said.encode(), service.log.encode(), *(file.read_bytes() for file in recordings)]
    assert all(SECRET.encode() not in text for text in texts)
    from drivers.recording import open_recording

    kept = open_recording(recordings[0]).configuration
    assert "(hidden)" in kept
    assert SECRET not in kept
