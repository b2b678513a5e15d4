"""What can go wrong in the service, one type per cause."""

import traceback
from pathlib import Path
from typing import ClassVar


class ServiceError(Exception):
    """Root of every error that the service raises on purpose."""


class ConfigurationError(ServiceError):
    """The configuration, or an option, is not one that can be used; says where, what and what to do."""


class PlanError(ConfigurationError):
    """The plan cannot be run on this stage: a pose is out of reach, or the plan is empty."""


class MotionError(ServiceError):
    """The stage does not move: nobody consents to homing it, or a movement failed; a person has to look."""


class WorkerError(ServiceError):
    """The fusion worker died or stopped answering, more often than a restart can mend."""


class HungError(WorkerError):
    """A worker gave no answer in time."""


class ClusterError(ServiceError):
    """A cluster cannot be used, or is gone: no answer, no workers, another version of this on them."""


class ClusterLostError(ClusterError):
    """A cluster went away after work was sent there."""


class OutputError(ServiceError):
    """A file could not be written: no space, no permission, or it exists already."""


class EncodingError(ServiceError):
    """An event could not be made into messages."""


class SinkError(ServiceError):
    """A sink cannot be used as it is named or set; says which and what is known."""


class SessionError(ServiceError):
    """The Zenoh session could not be opened, for example because its port is in use."""


class RemoteError(ServiceError):
    """A running service refused a request, or none answered."""


class CalibrationError(ServiceError):
    """What was shown to the camera does not determine a calibration; says what is missing."""


class UnmeasurableError(ServiceError):
    """A figure of quality cannot be had of what is there; says why."""


class CommandError(RemoteError):
    """A command was refused; nothing has changed. `code` says why, in one of eight words."""

    code: ClassVar[str] = "INTERNAL"


class InvalidArgumentError(CommandError):
    """An unknown verb or field, or a value of a wrong type."""

    code = "INVALID_ARGUMENT"


class OutOfRangeError(CommandError):
    """A value out of its bounds, or a plan out of the stage's reach."""

    code = "OUT_OF_RANGE"


class InvalidStateError(CommandError):
    """What the service is doing does not allow it."""

    code = "INVALID_STATE"


class NotFoundError(CommandError):
    """There is no such file."""

    code = "NOT_FOUND"


class PermissionDeniedError(CommandError):
    """A path outside the folder that it must be in."""

    code = "PERMISSION_DENIED"


class IoFailureError(CommandError):
    """A device or a disk failed over it."""

    code = "IO_FAILURE"


class UnavailableError(CommandError):
    """Not now: the service recovers a device, starts, ends, or has too much to do."""

    code = "UNAVAILABLE"


class InternalError(CommandError):
    """The service failed over it."""


COMMAND_ERRORS: dict[str, type[CommandError]] = {
    kind.code: kind
    for kind in (
        InvalidArgumentError,
        OutOfRangeError,
        InvalidStateError,
        NotFoundError,
        PermissionDeniedError,
        IoFailureError,
        UnavailableError,
        InternalError,
    )
}
"""Every kind of refusal, by its code."""


def internal(error: Exception) -> str:
    """One line on a fault of the program itself: what it is, and where it was raised."""
    where = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{Path(where.filename).name}:{where.lineno}"
    return f"internal error, {type(error).__name__}: {error} ({place})"
