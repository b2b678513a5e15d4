"""A sink whose options hold a secret."""

from pydantic import BaseModel

from service.messages.events import Event
from service.sinks.sink import Sink


class Quiet(Sink):
    """Does nothing with it."""

    class Options(BaseModel, extra="forbid"):
        password: str

    def take(self, event: Event) -> None:
        """Nothing."""
