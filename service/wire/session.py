"""The Zenoh session: a peer on loopback that nobody outside can reach until its own file says otherwise."""

import json
import logging
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Literal

import zenoh

from service.errors import SessionError
from service.leaving import within
from service.wire.addresses import DEFAULT_ENDPOINT
from service.wire.declarations import drop_publishers
from service.wire.links import address_of
from service.wire.sockets import holder
from service.wire.zenoh_file import ZenohFile, brief

_SETTINGS = {
    "scouting/multicast/enabled": "false",
    "timestamping/enabled": "true",  # caches and late joiners order values by time
    "transport/shared_memory/enabled": "true",
    # Whoever comes first waits for the other; Zenoh's own 1 s to 4 s would show.
    "connect/retry": "{period_init_ms: 100, period_max_ms: 500, period_increase_factor: 2}",
    # A fused map is 1.6 MB in batches of 64 KB. With Zenoh's defaults (2 batches, 50 ms) 3 of 75 maps at
    # 15 Hz were lost over idle TCP on loopback; with room for a whole map none, and a put takes 4 ms at most.
    "transport/link/tx/queue/size/data": "16",
    "transport/link/tx/queue/size/data_low": "16",
    "transport/link/tx/queue/size/data_high": "16",
    "transport/link/tcp/so_sndbuf": str(4 << 20),
    # How long one stuck subscriber may hold up the others for each image that it misses, in µs.
    "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": "20000",
    # Answers wait for a full link. One on which nothing moves for so long, µs, is closed; whoever is behind
    # it connects anew once it reads again.
    "transport/link/tx/queue/congestion_control/block/wait_before_close": "1000000",
}
"""What is put in force unless the given file says otherwise."""

_LOSSLESS = {"transport/link/tx/queue/congestion_control/block/wait_before_close": "5000000"}

_CLOSING = 0.5
"""Seconds that a session gets to close; usually it takes some milliseconds."""

_log = logging.getLogger(__name__)


@contextmanager
def open_session(
    listen: Sequence[str] = (DEFAULT_ENDPOINT,),
    connect: Sequence[str] = (),
    file: Path | None = None,
    mode: Literal["peer", "client"] = "peer",
    *,
    lossless: bool = False,
) -> Iterator[zenoh.Session]:
    """A session that is always closed: one that is not would hang the interpreter at its exit.

    Args:
        listen: endpoints such as `tcp/127.0.0.1:7447`; port 0 takes any.
        connect: endpoints to connect to; they may come up later.
        file: Zenoh's own JSON5 file; what it sets, defaults included, goes before everything here.
        mode: a `client` fails at once where nobody listens on `connect`; a `peer` keeps trying.
        lossless: what is published waits for slow subscribers; one that reads nothing gets Zenoh's own 5 s.

    Raises:
        SessionError: the file cannot be read, an endpoint is not one, or its port is in use.
    """
    config = _configuration(listen, connect, file, mode, lossless=lossless)
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise SessionError(_explain(str(error), config)) from error
    zid = str(session.info.zid())
    try:
        yield session
    finally:
        _close(session, zid)


def _close(session: zenoh.Session, zid: str) -> None:
    """Close it; a subscriber that stopped reading holds that up for Zenoh's own 10 s, and is left behind."""

    def close() -> None:
        with suppress(zenoh.ZError):  # not in time: then it is said below
            session.close()  # type: ignore[no-untyped-call]

    if within(_CLOSING, close, "closing"):
        drop_publishers(zid)
    else:
        _log.warning("the Zenoh session did not close in %g s: a subscriber has stopped reading", _CLOSING)


def _configuration(
    listen: Sequence[str], connect: Sequence[str], file: Path | None, mode: str, *, lossless: bool = False
) -> zenoh.Config:
    told = ZenohFile(file)
    settings = (
        _SETTINGS
        | (_LOSSLESS if lossless else {})
        | {
            "mode": json.dumps(mode),
            "listen/endpoints": json.dumps(list(listen)),
            "connect/endpoints": json.dumps(list(connect)),
        }
    )
    try:
        for key, value in settings.items():
            if not told.says(key):
                told.config.insert_json5(key, value)
    except zenoh.ZError as error:
        endpoints = ", ".join(map(address_of, [*listen, *connect]))
        raise SessionError(
            f"Zenoh refuses an endpoint of {endpoints}: {brief(str(error))}; expected for example "
            f"{DEFAULT_ENDPOINT}"
        ) from error
    return told.config


def _explain(error: str, config: zenoh.Config) -> str:
    in_use = re.search(r"bound to (\S+?:(\d+))[#:].*Address already in use", error)
    if in_use:
        endpoint, port = in_use.groups()
        who = holder(int(port)) or "another process"
        return (
            f"{endpoint} is in use by {who}; stop it, or name another port in a Zenoh file "
            f'(listen: {{ endpoints: ["tcp/127.0.0.1:7448"] }}) given as zenoh.config'
        )
    return (
        f"cannot open the Zenoh session (listen {brief(config.get_json('listen/endpoints'))}, connect "
        f"{brief(config.get_json('connect/endpoints'))}): {brief(error)}"
    )


def endpoint_of(file: Path | None) -> str:
    """Where programs of this machine find a service whose session has this file.

    Raises:
        SessionError: the file cannot be read, or neither listens nor connects anywhere.
    """
    config = _configuration((DEFAULT_ENDPOINT,), (), file, "peer")
    mode = json.loads(config.get_json("mode"))
    for key in ("listen/endpoints", "connect/endpoints"):
        told = json.loads(config.get_json(key))
        endpoints = told.get(mode, []) if isinstance(told, dict) else told
        if endpoints:
            return re.sub(r"/(0\.0\.0\.0|\[::\]):", "/127.0.0.1:", str(endpoints[0]))
    raise SessionError(f"{file}: the session neither listens nor connects anywhere")
