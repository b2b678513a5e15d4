"""The Zenoh session of ROS 2: one of its own, for no ROS node sees keys under the service's namespace."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh

from service.wire.addresses import DEFAULT_ENDPOINT
from service.wire.session import open_session
from service.wire.zenoh_file import ZenohFile

_EVERYWHERE = {"0.0.0.0": "127.0.0.1", "[::]": "[::1]"}
_LOOPBACK = "tcp/127.0.0.1:0"


@contextmanager
def open_ros_session(file: Path | None, service_file: Path | None) -> Iterator[zenoh.Session]:
    """A peer that is reached where the service's own session listens, and through the routers that it knows.

    Args:
        file: Zenoh's own JSON5 file for this session alone; None = as said.
        service_file: that of the service's session.

    Raises:
        SessionError: a file cannot be used.
    """
    connect = () if file is not None else service_endpoints(service_file)
    with open_session(listen=(_LOOPBACK,), connect=connect, file=file) as session:
        yield session


def service_endpoints(file: Path | None) -> list[str]:
    """Where the service's session is reached from this host, and where it connects to."""
    told = ZenohFile(file)
    listens = _endpoints(told, "listen/endpoints") if told.says("listen/endpoints") else [DEFAULT_ENDPOINT]
    here = [_reached(endpoint) for endpoint in listens if not endpoint.endswith(":0")]
    return [*here, *_endpoints(told, "connect/endpoints")]


def _endpoints(told: ZenohFile, key: str) -> list[str]:
    """A list, or one by mode, of which the peer's is taken."""
    value: Any = json.loads(told.config.get_json(key))
    if isinstance(value, dict):
        value = value.get("peer") or []
    return [value] if isinstance(value, str) else list(value or [])


def _reached(endpoint: str) -> str:
    for everywhere, here in _EVERYWHERE.items():
        endpoint = endpoint.replace(f"/{everywhere}:", f"/{here}:")
    return endpoint
