"""What can go wrong in the service, one type per cause."""


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
