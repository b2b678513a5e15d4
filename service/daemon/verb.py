"""What a command is made of: verbs, each of which says what it takes and how it is carried out."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar, Union

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails, from_json

from drivers.messages import Message, Schema
from drivers.text import json_of
from service.errors import CommandError, InvalidArgumentError, OutOfRangeError
from service.messages.status import State
from service.wire.encoding import Octets

if TYPE_CHECKING:
    from service.daemon.desk import Desk

T = TypeVar("T")

Place = Literal["here", "aside", "pose", "burst"]
"""Where a verb is carried out: at once, and without waiting for anything; in a thread of its own, which may
wait for a disk; or by the thread that owns the devices, between two poses or between two bursts."""

_BOUNDS = frozenset(
    ("greater_than", "greater_than_equal", "less_than", "less_than_equal", "finite_number", "multiple_of")
)


class Reply(BaseModel):
    """What every command answers; readers ignore fields that they do not know."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    state: State = Field(description="What the service is doing now.")
    reason: str = Field(description="Why it is in that state.")
    paused: bool = Field(False, description="Whether it stands still between two poses.")

    def payload(self) -> bytes:
        """JSON, without the fields that this reply does not give."""
        others = set(type(self).model_fields) - self.model_fields_set
        return json_of(self, others)


@dataclass(frozen=True, slots=True)
class Outcome:
    """A reply, and what goes after it: messages of topics, or bytes of a file."""

    reply: Reply
    messages: Sequence[Message | Octets] = ()


Answer = Reply | Outcome | Future[Outcome]
"""What a verb gives: what to answer, or what will be known of it later."""


class Verb(BaseModel):
    """One thing that can be asked for, with its arguments."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    place: ClassVar[Place] = "here"
    changes: ClassVar[bool] = True
    """Whether it is noted in log and recording who asked for it."""

    action: str

    @property
    def given(self) -> dict[str, Any]:
        """The arguments that were given."""
        return self.model_dump(exclude={"action"}, exclude_unset=True)

    def carry_out(self, desk: Desk) -> Answer:
        """Do it.

        Raises:
            CommandError: it is refused, and nothing was changed.
            ServiceError, DriverError: it failed.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class Command:
    """One row of the table.

    Attributes:
        name: key without prefix, `cmd/…`.
        description: what it is for.
        verbs: each with another literal `action`.
        reply: what it answers.
    """

    name: str
    description: str
    verbs: tuple[type[Verb], ...]
    reply: type[Reply] = Reply

    @cached_property
    def actions(self) -> dict[str, type[Verb]]:
        """The verbs by their names."""
        return {verb.model_fields["action"].annotation.__args__[0]: verb for verb in self.verbs}  # type: ignore[union-attr]

    @cached_property
    def schema(self) -> Schema:
        """JSON schemas of what it takes and answers: `{"request": …, "reply": …}`."""
        taken: Any = Union[self.verbs]  # noqa: UP007 — made of a tuple
        if len(self.verbs) > 1:
            taken = Annotated[taken, Field(discriminator="action")]
        both = {
            "request": TypeAdapter(taken).json_schema(),
            "reply": self.reply.model_json_schema(mode="serialization"),
        }
        return Schema(self.schema_name, "jsonschema", json.dumps(both).encode())

    @property
    def schema_name(self) -> str:
        """What the schema is called; that itself takes a tenth of a second to make."""
        return f"lidarboost.{self.reply.__name__.removesuffix('Reply')}Command"

    def read(self, payload: bytes) -> Verb:
        """The verb of a request.

        Raises:
            InvalidArgumentError: not JSON, no verb of this command, a field that it does not know, or a value
                of a wrong type.
            OutOfRangeError: a value out of its bounds.
        """
        try:
            document = from_json(payload, allow_inf_nan=False)
        except ValueError as error:
            raise InvalidArgumentError(f"{self.name}: not JSON ({error})") from error
        action = document.get("action") if isinstance(document, dict) else None
        verb = self.actions.get(action) if isinstance(action, str) else None
        if verb is None:
            raise InvalidArgumentError(
                f'{self.name}: expected {{"action": …}} with one of {", ".join(self.actions)}; '
                f"got {_brief(action if isinstance(document, dict) else document)}"
            )
        try:
            return verb.model_validate_json(payload)
        except ValidationError as error:
            raise refusal_of_fields(f"{self.name} {action}", verb, error) from error


def refusal_of_fields(what: str, model: type[BaseModel], error: ValidationError) -> CommandError:
    """Says which fields are wrong and what is allowed; `OUT_OF_RANGE` where only bounds are crossed."""
    faults = _distinct(error.errors(include_url=False, include_context=False))
    kind = OutOfRangeError if all(f["type"] in _BOUNDS for f in faults) else InvalidArgumentError
    return kind(f"{what}: " + "; ".join(_words(fault, model) for fault in faults[:5]))


def then(future: Future[T], make: Callable[[T], Outcome]) -> Future[Outcome]:
    """What is made of a result once it is there."""
    made: Future[Outcome] = Future()

    def done(finished: Future[T]) -> None:
        try:
            made.set_result(make(finished.result()))
        except BaseException as error:
            made.set_exception(error)

    future.add_done_callback(done)
    return made


def _distinct(faults: list[ErrorDetails]) -> list[ErrorDetails]:
    """Of a field that may be of several types only the bound that is crossed, where one of them fits."""
    bounded = {fault["loc"][:1] for fault in faults if fault["type"] in _BOUNDS}
    return [fault for fault in faults if fault["type"] in _BOUNDS or fault["loc"][:1] not in bounded]


def _words(fault: ErrorDetails, model: type[BaseModel]) -> str:
    if not fault["loc"]:
        return fault["msg"].removeprefix("Value error, ")
    name = str(fault["loc"][0])
    known = [field for field in model.model_fields if field != "action"]
    if fault["type"] == "extra_forbidden":
        return f"unknown field {_brief(name)} (known: {', '.join(known) or 'none'})"
    field = model.model_fields.get(name)
    meaning = f" ({field.description})" if field is not None and field.description else ""
    if fault["type"] == "missing":
        return f"{_brief(name)} is missing{meaning}"
    return f"{name} = {_brief(fault['input'])}: {fault['msg']}{meaning}"


def _brief(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:80]}…"
