"""What a page may ask of the server."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic_core import from_json

from service.errors import InvalidArgumentError

_TOPIC = Annotated[str, Field(max_length=64)]


class _Request(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class Show(_Request):
    """Send these images from now on, and no others."""

    type: Literal["show"]
    images: list[_TOPIC] = Field(max_length=16)


class Ack(_Request):
    """An image was drawn: the next may come."""

    type: Literal["ack"]
    topic: _TOPIC


class Command(_Request):
    """Have a command of the rig carried out."""

    type: Literal["command"]
    id: int = Field(ge=-(2**53), le=2**53)
    name: str = Field(pattern=r"^cmd/[a-z_]{1,40}$")
    action: str = Field(pattern=r"^[a-z_]{1,40}$")
    arguments: dict[str, Any] = {}
    timeout: float = Field(60.0, ge=1, le=600)


Request = Show | Ack | Command

_REQUESTS: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="type")])


def read_request(text: str) -> Request:
    """One message of a page.

    Raises:
        InvalidArgumentError: not JSON, or not one of the three.
    """
    try:
        return _REQUESTS.validate_python(from_json(text, allow_inf_nan=False))
    except ValidationError as error:
        fault = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(str(step) for step in fault["loc"][1:])
        raise InvalidArgumentError(
            f"expected a JSON object of type show, ack or command; {where or 'it'}: {fault['msg']}"
        ) from error
    except ValueError as error:
        raise InvalidArgumentError(f"expected a JSON object of type show, ack or command; {error}") from error
