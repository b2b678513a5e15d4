"""What anybody may read without knowing anything: who this is, and how its payloads are read."""

from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Self

import zenoh

from drivers.messages import Schema
from service.allowance import Allowance
from service.wire.addresses import MANIFEST, SCHEMA
from service.wire.declarations import withdraw

_PER_SECOND, _BURST = 50.0, 200.0
"""Answers that are given, in the long run and at once; beyond that a query stays without one."""


class Answers:
    """Answers `manifest` and `schema/<topic or command>`, wildcards too.

    Args:
        session: open; it must outlive this.
        prefix: of every key.
        manifest: gives it, JSON.
        schemas: by topic or command.
    """

    def __init__(
        self,
        session: zenoh.Session,
        prefix: str,
        manifest: Callable[[], bytes],
        schemas: Callable[[], Mapping[str, Schema]],
    ) -> None:
        self._session, self._prefix = session, prefix
        self._manifest, self._schemas = manifest, schemas
        self._allowance = Allowance(_PER_SECOND, _BURST)

    def __enter__(self) -> Self:
        self._declared = [
            self._session.declare_queryable(f"{self._prefix}/{MANIFEST}", self._answer_manifest),
            self._session.declare_queryable(f"{self._prefix}/{SCHEMA}/**", self._answer_schemas),
        ]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        withdraw(self._declared)

    def _answer_manifest(self, query: zenoh.Query) -> None:
        with query:
            if self._allowance.spend():
                query.reply(
                    f"{self._prefix}/{MANIFEST}", self._manifest(), encoding=zenoh.Encoding.APPLICATION_JSON
                )

    def _answer_schemas(self, query: zenoh.Query) -> None:
        with query:
            if not self._allowance.spend():
                return
            for name, schema in self._schemas().items():
                key = f"{self._prefix}/{SCHEMA}/{name}"
                if query.key_expr.intersects(key):
                    query.reply(key, schema.data, encoding=_encoding(schema))


def _encoding(schema: Schema) -> zenoh.Encoding:
    if schema.encoding == "jsonschema":
        return zenoh.Encoding.APPLICATION_JSON
    return zenoh.Encoding.APPLICATION_PROTOBUF.with_schema("google.protobuf.FileDescriptorSet")
