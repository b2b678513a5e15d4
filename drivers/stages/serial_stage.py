"""What stages on a serial line have in common: the port, and opening it."""

from abc import abstractmethod
from typing import Literal

from pydantic import Field

from drivers.motion import MotionOptions
from drivers.stage import Stage
from drivers.stages.serial_line import SerialLine

Sign = Literal[1, -1]
"""Which way an axis counts: 1 where its own positive direction is left (pan) or up (tilt)."""


class SerialOptions(MotionOptions):
    """Where the stage is connected, and what it may do."""

    port: str = Field(
        min_length=1,
        description="Serial port or pyserial URL, such as /dev/serial/by-id/usb-… or socket://host:4000.",
    )
    baud_rate: int = Field(9600, ge=300, le=4_500_000, description="Bits per second.")


class SerialStage(Stage):
    """A stage on a serial line; a backend fills `_greet` and the hooks of `Stage`.

    Whatever waits for bytes of the line looks whether the stage is interrupted, and raises then.
    """

    options: SerialOptions
    _line: SerialLine

    def _open(self) -> None:
        self._line = SerialLine.open(self.options.port, self.options.baud_rate, self.clock, self._heed)
        try:
            self._greet()
        except BaseException:
            self._line.close()
            raise

    def _close(self) -> None:
        self._line.close()

    def __str__(self) -> str:
        return f"{type(self).__name__} on {self.options.port}"

    @abstractmethod
    def _greet(self) -> None:
        """Make sure that the right device answers, set it up, learn its steps and limits; move nothing."""
