"""What can go wrong with a device or a recording, one type per phase."""


class DriverError(Exception):
    """Root of every error that a driver raises on purpose."""


class NotAvailableError(DriverError):
    """The backend cannot be used here: unknown name, missing library, device not found, no permission."""


class InitialisationError(DriverError):
    """The device was found, but could not be opened or set up; also settings it refuses."""


class OperationError(DriverError):
    """An open device failed to do what it was asked."""


class StateError(OperationError):
    """The call does not fit the state of the device, for example `grab` before `start`."""


class DeviceLostError(OperationError):
    """The device stopped answering or was unplugged; it must be opened again."""


class LimitError(OperationError):
    """A stage was asked to go, or has run, beyond its limits."""


class DeviceTimeoutError(OperationError, TimeoutError):
    """No frame, or no end of a movement, within the time allowed."""


class MotionStoppedError(DriverError):
    """A stage was interrupted: it has stopped, or did not begin to move."""


class EndOfRecordingError(OperationError):
    """A camera that plays a recording has no frame left."""


class RecordingError(DriverError):
    """A file is not a recording that can be read: wrong format, torn, empty, or without what is needed."""


class StorageError(DriverError):
    """A recording cannot be written: disk full, no permission. What was written before stays readable."""
