"""What verbs work with: the daemon, seen from those who command it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import ValidationError

from service.capture.inbox import Moment
from service.config.sections import FusionSection, PlanSection, StreamSection
from service.daemon.modes import Idle, Mode, Scanning, Streaming
from service.daemon.verb import Reply, refusal_of_fields
from service.errors import InvalidStateError, UnavailableError

if TYPE_CHECKING:
    from service.daemon.daemon import Daemon

R = TypeVar("R", bound=Reply)
S = TypeVar("S", FusionSection, PlanSection, StreamSection)


class Desk:
    """One daemon and what can be asked of it.

    Verbs that are carried out `here` or `aside` may read it, ask for another mode and pause; everything that
    touches a device, `reconfigure` included, is for those `between` poses or bursts.

    Args:
        daemon: at work.
    """

    def __init__(self, daemon: Daemon) -> None:
        self.daemon = daemon

    def reply(self, kind: type[R], **fields: Any) -> R:
        """A reply with the state as it is now."""
        states, control = self.daemon.states, self.daemon.control
        return kind(state=states.state, reason=states.reason, paused=control.paused, **fields)

    @property
    def mode(self) -> Mode:
        """What the daemon is doing; raises `UnavailableError` while it starts."""
        mode, states = self.daemon.mode, self.daemon.states
        if mode is None or states.state in ("starting", "stopping"):
            raise UnavailableError(f"{states.state}: {states.reason}")
        return mode

    @property
    def is_idle(self) -> bool:
        return isinstance(self.mode, Idle)

    @property
    def is_scanning(self) -> bool:
        return isinstance(self.mode, Scanning)

    @property
    def is_streaming(self) -> bool:
        return isinstance(self.mode, Streaming)

    def admit(self, moment: Moment) -> None:
        """Raise why nothing can be done between two bursts, or poses."""
        states = self.daemon.states
        _ = self.mode
        if moment == "burst" and states.state == "recovering":
            raise UnavailableError(f"recovering: {states.reason}; wait until the device is back")
        if moment == "burst" and self.daemon.control.paused:
            raise InvalidStateError("paused in a burst: resume or cancel it first")

    def changed(self, section: S, fields: dict[str, Any]) -> S:
        """A section with some fields changed; raises where they do not go together."""
        try:
            return type(section).model_validate({**section.model_dump(), **fields})
        except ValidationError as error:
            raise refusal_of_fields("what is set", type(section), error) from error
