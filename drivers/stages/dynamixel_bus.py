"""Registers of Dynamixel servos on one half-duplex line."""

from __future__ import annotations

from drivers.clock import Clock
from drivers.errors import DeviceLostError, LimitError, OperationError
from drivers.stages.dynamixel_packets import ALERT, STATUS, Packet, decode, encode
from drivers.stages.serial_line import SerialLine

PING, READ, WRITE = 1, 2, 3

ANSWER_SECONDS = 0.2
"""Packets take 4 ms at 57600 baud, USB adapters add up to 16 ms."""

QUIET_SECONDS = 0.02
LIMIT = 6

ERRORS = {
    1: "it could not process the instruction",
    2: "unknown instruction",
    3: "damaged packet (CRC)",
    4: "value out of range",
    5: "value too short or too long",
    LIMIT: "value beyond the servo's limits",
    7: "register cannot be written now",
}


class DynamixelBus:
    """Reads and writes registers; every packet may be repeated without harm."""

    def __init__(self, line: SerialLine, clock: Clock) -> None:
        self._line = line
        self._clock = clock

    def ping(self, device: int) -> None:
        """Raise unless the servo answers; raises as `read`."""
        self._exchange(Packet(device, PING, b""))

    def read(self, device: int, address: int, size: int) -> int:
        """The signed value of a register of `size` bytes.

        Raises:
            OperationError: the servo reports an error or a hardware alert.
            LimitError: it reports that a value is beyond its limits.
            DeviceLostError: it does not answer.
        """
        parameters = address.to_bytes(2, "little") + size.to_bytes(2, "little")
        data = self._exchange(Packet(device, READ, parameters))
        return int.from_bytes(data[:size], "little", signed=True)

    def write(self, device: int, address: int, size: int, value: int) -> None:
        """Set a register of `size` bytes; raises as `read`."""
        parameters = address.to_bytes(2, "little") + value.to_bytes(size, "little", signed=value < 0)
        self._exchange(Packet(device, WRITE, parameters))

    def _exchange(self, packet: Packet) -> bytes:
        for _ in range(2):  # once more where noise spoilt it
            self._line.pending()  # late answers and noise
            self._line.send(encode(packet))
            answer = self._answer(packet.device)
            if answer is not None:
                self._raise_if_refused(packet.device, answer[0])
                return answer[1:]
            self._line.discard(QUIET_SECONDS)
        raise DeviceLostError(
            f"{self._line.name}: Dynamixel {packet.device} does not answer; check its power, its cable, "
            "its id and the baud rate (57600 as delivered), then close it, open it again and home it"
        )

    def _answer(self, device: int) -> bytes | None:
        """Error byte and parameters of the status packet; an adapter's echo of our own packet is skipped."""
        data = b""
        deadline = self._clock.now() + round(ANSWER_SECONDS * 1e9)
        while (remaining := (deadline - self._clock.now()) / 1e9) > 0:
            data += self._line.receive(remaining)
            while True:
                packet, data = decode(data)
                if packet is None:
                    break
                if packet.device == device and packet.instruction == STATUS and packet.parameters:
                    return packet.parameters
        return None

    def _raise_if_refused(self, device: int, error: int) -> None:
        code = error & ~ALERT
        if code:
            kind = LimitError if code == LIMIT else OperationError
            raise kind(
                f"{self._line.name}: Dynamixel {device} reports error {code}: {ERRORS.get(code, 'unknown')}"
            )
        if error & ALERT:
            raise OperationError(
                f"{self._line.name}: Dynamixel {device} has raised a hardware alert (overload, heat or "
                "supply voltage) and may have let go; remove the cause and power it anew"
            )
