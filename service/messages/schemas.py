"""The schema of every topic, as it stands in a recording."""

from functools import cache

from drivers.messages import FrameFields, Schema, json_schema, protobuf_schema
from service.messages.decoding import message_class
from service.messages.progress import ScanProgress
from service.messages.report import BurstReport
from service.messages.status import Status
from service.messages.topics import TOPICS, Congestion

_MODELS = (FrameFields, BurstReport, ScanProgress, Status)


@cache
def topic_schemas() -> dict[str, Schema]:
    """By topic: FileDescriptorSet or JSON schema."""
    models = {schema.name: schema for schema in map(json_schema, _MODELS)}
    return {
        name: models[row.schema] if row.schema in models else _protobuf(row.schema)
        for name, row in TOPICS.items()
        if row.congestion is not Congestion.NONE
    }


def _protobuf(name: str) -> Schema:
    return protobuf_schema(message_class(name))  # type: ignore[arg-type]  # a class is hashable
