"""Models as JSON that any reader can take."""

from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticSerializationError, to_json

from drivers.names import shown


def json_of(model: BaseModel, exclude: set[str] | None = None) -> bytes:
    """A model as JSON, whatever names of files it holds; numbers that JSON lacks become null."""
    try:
        return model.model_dump_json(exclude=exclude).encode()
    except PydanticSerializationError:  # bytes of a name that are no text
        return to_json(_shown(model.model_dump(mode="json", exclude=exclude)), inf_nan_mode="null")


def _shown(value: Any) -> Any:
    if isinstance(value, str):
        return shown(value)
    if isinstance(value, dict):
        return {_shown(key): _shown(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_shown(one) for one in value]
    return value
