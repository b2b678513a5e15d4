"""What the kernel knows of TCP sockets: who listens on a port, and what is still under way to a peer.

Linux only (`/proc/net/tcp`); elsewhere nothing is known, and callers go by time instead.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import zenoh

_LISTEN = "0A"
"""TCP_LISTEN in the kernel's include/net/tcp_states.h, as `/proc/net/tcp` prints it."""


@dataclass(frozen=True, slots=True)
class Socket:
    """One row of the kernel's table: ports, bytes not yet acknowledged and not yet read, inode."""

    local: int
    remote: int
    state: str
    unsent: int
    unread: int
    inode: str


def holder(port: int) -> str | None:
    """Who listens on a TCP port of this machine, as `process 1234 (name)`; None where that cannot be seen."""
    inodes = {row.inode for row in _table() if row.state == _LISTEN and row.local == port}
    for link in Path("/proc").glob("[0-9]*/fd/*") if inodes else ():
        try:
            target = str(link.readlink())
            if target.startswith("socket:[") and target[8:-1] in inodes:
                process = link.parent.parent
                name = (process / "comm").read_text(encoding="utf-8").strip()
                return f"process {process.name} ({name})"
        except OSError:  # gone meanwhile, or another user's
            continue
    return None


def ports_of(session: zenoh.Session) -> Iterator[tuple[int, int]]:
    """(local port, remote port) of each of its links over TCP, with TLS or without."""
    for link in session.info.links():
        if is_tcp(link.src):
            yield _port(link.src), _port(link.dst)


def is_tcp(locator: str) -> bool:
    """Whether what Zenoh calls so is a TCP connection."""
    return locator.startswith(("tcp/", "tls/"))


def _port(locator: str) -> int:
    return int(locator.partition("?")[0].rpartition(":")[2])


def bytes_under_way(links: Iterable[tuple[int, int]]) -> int | None:
    """Bytes that peers have not taken: not acknowledged by their kernel or, on this machine, not yet read.

    Args:
        links: (local port, remote port) of each connection.

    Returns:
        None where the kernel's table cannot be read.
    """
    wanted = {pair for local, remote in links for pair in ((local, remote), (remote, local))}
    table = list(_table())
    if wanted and not table:
        return None
    return sum(row.unsent + row.unread for row in table if (row.local, row.remote) in wanted)


def _table() -> Iterator[Socket]:
    for path in (Path("/proc/net/tcp"), Path("/proc/net/tcp6")):
        try:
            lines = path.read_text(encoding="ascii").splitlines()[1:]
        except OSError:
            continue
        for line in lines:
            fields = line.split()
            unsent, unread = fields[4].split(":")
            yield Socket(
                local=int(fields[1].rpartition(":")[2], 16),
                remote=int(fields[2].rpartition(":")[2], 16),
                state=fields[3],
                unsent=int(unsent, 16),
                unread=int(unread, 16),
                inode=fields[9],
            )
