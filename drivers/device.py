"""What cameras and stages have in common: options, a clock, and being open or closed."""

from abc import ABC, abstractmethod
from types import TracebackType
from typing import ClassVar, Self

from pydantic import BaseModel, ConfigDict

from drivers.clock import Clock, SystemClock
from drivers.errors import DriverError, NotAvailableError, StateError


class BackendOptions(BaseModel):
    """What a backend needs to find and open its device; each backend extends it. Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Device(ABC):
    """Something that is opened, used and closed.

    Args:
        options: the backend's own options; its defaults where not given.
        clock: time source; a virtual one makes simulated devices run at once.
    """

    Options: ClassVar[type[BackendOptions]] = BackendOptions

    def __init__(self, options: BackendOptions | None = None, clock: Clock | None = None) -> None:
        self.options = options if options is not None else self.Options()
        self.clock: Clock = clock if clock is not None else SystemClock()
        self._is_open = False

    @property
    def is_open(self) -> bool:
        return self._is_open

    def open(self) -> None:
        """Find the device and set it up. Opening an open device does nothing.

        Raises:
            NotAvailableError: the device, its port or its library is not there.
            InitialisationError: it is there, but does not answer as it should.
        """
        if self._is_open:
            return
        try:
            self._open()
        except DriverError:  # some are of the system's kinds, too
            raise
        except OSError as error:
            named = "" if error.filename is None else f"{error.filename}: "
            raise NotAvailableError(
                f"{type(self).__name__} cannot be opened: {named}{error.strerror or error}; check that the "
                "device or file is there, that nothing else uses it and that you may use it"
            ) from error
        self._is_open = True

    def close(self) -> None:
        """Release the device; safe for one that is already closed, or gone."""
        if self._is_open:
            self._is_open = False
            self._close()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _require_open(self, action: str) -> None:
        if not self._is_open:
            raise StateError(f"cannot {action} a {type(self).__name__} that is closed: open it first")

    @abstractmethod
    def _open(self) -> None:
        """Find and set up; leave nothing claimed when raising."""

    @abstractmethod
    def _close(self) -> None:
        """Release everything; must not raise for a device that is gone."""
