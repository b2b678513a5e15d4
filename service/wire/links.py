"""Which of the endpoints that a Zenoh file says to connect to are connected at present."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import zenoh

from service.wire.zenoh_file import ZenohFile


class Links:
    """The connections that a session was told to hold.

    Args:
        session: open.
        file: Zenoh's own JSON5 file that it was opened with, or None.
    """

    def __init__(self, session: zenoh.Session, file: Path | None) -> None:
        self._session = session
        config = ZenohFile(file).config
        told = json.loads(config.get_json("connect/endpoints"))
        mode = json.loads(config.get_json("mode")) or "peer"
        choices = dict.fromkeys(_choices(told.get(mode, ()) if isinstance(told, dict) else told))
        self._choices = {" or ".join(choice): choice for choice in choices}
        self.wanted = tuple(self._choices)

    def connected(self) -> dict[str, str]:
        """The id of whoever is at the other end, by what was wanted; what has no connection is not in it.

        An endpoint that names a host is told apart by protocol and port: what the name stands for may change.
        """
        links = {address_of(link.dst): str(link.zid) for link in self._session.info.links()}
        found: dict[str, str] = {}
        for matches in (str.__eq__, _same_port):
            for name, choice in self._choices.items():
                match = next((one for one in links for wanted in choice if matches(one, wanted)), None)
                if name not in found and match is not None:
                    found[name] = links.pop(match)
        return found


def address_of(endpoint: str) -> str:
    """`tcp/host:port` of an endpoint, without what else it says: that may hold keys."""
    return endpoint.partition("?")[0].partition("#")[0]


def _choices(told: Any) -> Iterable[tuple[str, ...]]:
    """The addresses to connect to; of several in one entry, one suffices."""
    for one in told or ():
        if isinstance(one, str):
            yield (address_of(one),)
        elif one["strategy"] == "oneOf":
            yield tuple(map(address_of, one["locators"]))
        else:
            yield from _choices(one["locators"])


def _same_port(address: str, wanted: str) -> bool:
    host = wanted.partition("/")[2].rpartition(":")[0]
    if not host or host.replace(".", "").isdigit() or host.startswith("["):
        return False
    protocol, port = wanted.partition("/")[0], wanted.rpartition(":")[2]
    return address.partition("/")[0] == protocol and address.rpartition(":")[2] == port
