"""Who this is: what a program that knows nothing of the service needs to use it."""

from collections.abc import Mapping

from pydantic import BaseModel, ConfigDict, Field

from drivers.messages import Schema
from service.daemon.daemon import Daemon
from service.daemon.verb import Command
from service.messages.schemas import topic_schemas
from service.messages.status import State
from service.messages.topics import TOPICS, Topic
from service.versions import software_version


class TopicEntry(BaseModel):
    """A topic that is published."""

    name: str = Field(description="Key, without the prefix.")
    schema_name: str = Field(description="Name of the schema; itself at `schema/<name>`.")
    unit: str = Field(description="Of its values.")
    rate: str = Field(description="How often, in words.")
    latest: bool = Field(description="Whether `get` answers with the latest value.")
    description: str


class CommandEntry(BaseModel):
    """A command that can be asked."""

    name: str = Field(description="Key, without the prefix.")
    schema_name: str = Field(description="Of request and reply; both at `schema/<name>`.")
    unit: str = Field("SI", description="Of its values; angles in degrees where a field says so.")
    rate: str = Field("on request", description="How often, in words.")
    actions: dict[str, str] = Field(description="What each verb does.")
    description: str


class Manifest(BaseModel):
    """What this service is and offers."""

    model_config = ConfigDict(title="Manifest")

    version: str = Field(description="Of the software.")
    rig: str = Field(description="What every key begins with.")
    model: str | None = Field(description="What the camera is; none while it is not open.")
    source: str | None = Field(description="`device`, `replay` or `simulation`.")
    state: State = Field(description="What it is doing.")
    reason: str = Field(description="Why it is in that state.")
    topics: tuple[TopicEntry, ...]
    commands: tuple[CommandEntry, ...]


def manifest_of(daemon: Daemon, table: Mapping[str, Command]) -> Manifest:
    """What a daemon is now; touches no device."""
    camera = daemon.camera
    return Manifest(
        version=software_version(),
        rig=daemon.configuration.zenoh.prefix,
        model=None if camera is None else camera.model,
        source=None if camera is None else camera.source,
        state=daemon.states.state,
        reason=daemon.states.reason,
        topics=tuple(_topic(row) for row in TOPICS.values()),
        commands=tuple(_command(command) for command in table.values()),
    )


def schemas(table: Mapping[str, Command]) -> dict[str, Schema]:
    """The schema of every topic, and JSON schemas of `request` and `reply` of every command, by name."""
    return topic_schemas() | {name: command.schema for name, command in table.items()}


def _topic(row: Topic) -> TopicEntry:
    return TopicEntry(
        name=row.name,
        schema_name=row.schema,
        unit=row.unit,
        rate=row.rate,
        latest=row.latest,
        description=row.description,
    )


def _command(command: Command) -> CommandEntry:
    return CommandEntry(
        name=command.name,
        schema_name=command.schema_name,
        actions={action: (verb.__doc__ or "").strip() for action, verb in command.actions.items()},
        description=command.description,
    )
