"""A site after `deploy/`: its authority, a router with access rules, a rig behind it, and people."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import zenoh

from service.sinks.publisher import Publisher
from service.wire.client import Client
from service.wire.session import open_session

DEPLOY = Path(__file__).parents[2] / "deploy"
PREFIX = "bench/lidarboost/rig"


def certificates(folder: Path, *names: str) -> Path:
    """Made by the script in `deploy/`."""
    script = [sys.executable, str(DEPLOY / "certificates.py"), str(folder), *names]
    subprocess.run(script, check=True, capture_output=True, timeout=60)
    return folder


class Site:
    """Certificates and files of a site whose router listens on a port of this machine."""

    def __init__(self, folder: Path, endpoint: str, tls: Path | None = None) -> None:
        self.folder, self.endpoint = folder, endpoint
        people = ("router", "rig", "viewer", "operator", "stranger")
        self.tls = tls or certificates(folder / "tls", *people)

    def file(self, name: str, who: str = "", tls: Path | None = None) -> Path:
        """A file of `deploy/` with this site's paths and endpoint, and another's certificate where named."""
        text = (DEPLOY / name).read_text(encoding="utf-8")
        changes = {
            "/etc/lidarboost/tls": str(tls or self.tls),
            "tls/0.0.0.0:7447": self.endpoint,
            "tls/router.site:7447": self.endpoint,
        }
        if who:
            changes |= {"/anna.": f"/{who}."}
        for old, new in changes.items():
            text = text.replace(old, new)
        file = self.folder / f"{who or 'its'}-{name}"
        file.write_text(text, encoding="utf-8")
        return file

    @contextmanager
    def router(self) -> Iterator[zenoh.Session]:
        with open_session(file=self.file("zenoh-secure-router.json5")) as session:
            yield session

    @contextmanager
    def rig(self, asked: list[str]) -> Iterator[Publisher]:
        """A publisher and two commands, as a service has them."""
        with ExitStack() as stack:
            session = stack.enter_context(open_session(file=self.file("zenoh-secure-rig.json5")))
            publisher = Publisher(session)
            publisher.open()
            stack.callback(publisher.close)
            for name in ("cmd/scan", "cmd/stage"):
                answering = session.declare_queryable(publisher.key(name), _answering(asked))
                stack.callback(answering.undeclare)
            yield publisher

    @contextmanager
    def person(self, who: str) -> Iterator[Client]:
        file = self.file("zenoh-secure-client.json5", who)
        with Client(prefix=PREFIX, config=file) as client:
            yield client


def _answering(asked: list[str]) -> Callable[[zenoh.Query], None]:
    def answer(query: zenoh.Query) -> None:
        with query:
            asked.append(str(query.selector))
            query.reply(query.key_expr, b'{"state": "idle"}', encoding=zenoh.Encoding.APPLICATION_JSON)

    return answer
