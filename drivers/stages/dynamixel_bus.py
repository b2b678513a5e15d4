"""Registers of Dynamixel X servos on one half-duplex line.

Answers carry no number. What is asked here differs in length wherever a mix-up would matter, so that an
answer which is late or doubled is told from the one that is awaited: a status packet has its servo's id and
the length that was asked for. The line keeps order, so what comes before a right answer is late and dropped.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import cycle

from drivers.clock import Clock
from drivers.errors import DeviceLostError, LimitError, OperationError
from drivers.stages.dynamixel_packets import ALERT, STATUS, Packet, decode, encode
from drivers.stages.serial_line import SerialLine

PING, READ, WRITE = 1, 2, 3

ANSWER_SECONDS = 0.25
GLANCE_SECONDS = 0.1
"""Question and answer take 55 ms at 9600 baud, USB adapters add up to 16 ms."""

ATTEMPTS = 12
"""A line may stall for two or three seconds. Fewer than there are lengths of `MOTION_BYTES`."""

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

# Control table of the X series (emanual.robotis.com/docs/en/dxl/x/xl430-w250): address, bytes. The lengths
# of the blocks that are read differ from each other.
DRIVE = 10, 2
HOMING_OFFSET = 20, 4
RANGE = 44, 12
TORQUE = 64, 1
CONDITION = 64, 7
PROFILE = 108, 12
GOAL = 112, 8
TICK = 120
MOTION_BYTES = range(16, 29)
"""From the tick to the position (132) at least, to the last assigned register (147) at most."""


@dataclass(frozen=True, slots=True)
class Drive:
    """How a servo is set up; positions and velocities in its own units.

    Attributes:
        profile_by_time: its profile velocity is a time.
        operating_mode: 3 = position, 4 = extended position.
        homing_offset: counts that it adds to what its encoder reads.
        velocity: limit, units of 0.229 rev/min.
        low, high: limits of the goal in position mode.
    """

    profile_by_time: bool
    operating_mode: int
    homing_offset: int
    velocity: int
    low: int
    high: int


@dataclass(frozen=True, slots=True)
class Condition:
    """Whether a servo holds its axis, what it answers (2 = everything), its hardware error status."""

    torque: bool
    status_return_level: int
    hardware_error: int


@dataclass(frozen=True, slots=True)
class Motion:
    """Whether a servo moves, and its present position in counts."""

    moving: bool
    position: int


class DynamixelBus:
    """What a stage asks of its servos and tells them; every packet may be repeated without harm.

    Every method raises `OperationError` where a servo reports an error, `LimitError` where it says that a
    value is beyond its limits, and `DeviceLostError` where it does not answer.

    Attributes:
        alerted: servos whose last answer carried a hardware alert.
    """

    def __init__(self, line: SerialLine, clock: Clock) -> None:
        self._line = line
        self._clock = clock
        self._motion_bytes = cycle(MOTION_BYTES)
        self._owed = False
        self.alerted: set[int] = set()

    def ping(self, device: int) -> None:
        """Raise unless the servo answers."""
        for _ in range(ATTEMPTS):
            if self._ask(Packet(device, PING, b""), 3) is not None:
                return
        raise self._silent(device)

    def drive(self, device: int) -> Drive:
        """How the servo is set up."""
        mode = self._read(device, *DRIVE)
        offset = self._read(device, *HOMING_OFFSET)
        limits = self._read(device, *RANGE)
        velocity, high, low = (_number(limits[at : at + 4]) for at in (0, 4, 8))
        return Drive(bool(mode[0] & 4), mode[1], _number(offset), velocity, low, high)

    def condition(self, device: int) -> Condition:
        """Whether the servo holds its axis, and what is wrong with it."""
        data = self._read(device, *CONDITION)
        return Condition(bool(data[0]), data[4], data[6])

    def motion(self, device: int) -> Motion:
        """Where the servo stands; lengths that go round keep older answers from being taken for this one."""
        for _ in range(ATTEMPTS):
            if (found := self.glance(device, ANSWER_SECONDS)) is not None:
                return found
        raise self._silent(device)

    def glance(self, device: int, seconds: float = GLANCE_SECONDS) -> Motion | None:
        """Where the servo stands, if it says so at once."""
        size = next(self._motion_bytes)
        data = self._ask(_reading(device, TICK, size), size, seconds)
        return None if data is None else Motion(bool(data[2]), _number(data[12:16]))

    def goal(self, device: int) -> tuple[int, int]:
        """The profile velocity and the goal that the servo has in its registers."""
        data = self._read(device, *GOAL)
        return _number(data[:4]), _number(data[4:])

    def go(self, device: int, acceleration: int, velocity: int, goal: int) -> None:
        """Set profile and goal in one packet, so that no goal is ever met at another speed."""
        self._write(_writing(device, PROFILE[0], acceleration, velocity, goal))

    def send(self, device: int, acceleration: int, velocity: int, goal: int) -> None:
        """As `go`, without waiting for an answer."""
        self._owed = True
        self._line.send(encode(_writing(device, PROFILE[0], acceleration, velocity, goal)))

    def hold(self, device: int) -> None:
        """Switch the torque on."""
        self._write(Packet(device, WRITE, TORQUE[0].to_bytes(2, "little") + b"\x01"))

    def _read(self, device: int, address: int, size: int) -> bytes:
        for _ in range(ATTEMPTS):
            # What is late comes before the answer to a glance.
            if not self._owed or self.glance(device, ANSWER_SECONDS) is not None:
                data = self._ask(_reading(device, address, size), size)
                if data is not None:
                    return data
        raise self._silent(device)

    def _write(self, packet: Packet) -> None:
        """Sent at once, and perhaps acknowledged by the answer to another: what matters is read back."""
        for _ in range(ATTEMPTS):
            if self._ask(packet, 0) is not None:
                return
        raise self._silent(packet.device)

    def _ask(self, packet: Packet, size: int, seconds: float = ANSWER_SECONDS) -> bytes | None:
        """Parameters of the status packet that answers; an adapter's echo of our own packet is skipped."""
        self._line.pending()  # late answers and noise
        self._owed = True
        self._line.send(encode(packet))
        data = b""
        deadline = self._clock.now() + round(seconds * 1e9)
        while (remaining := (deadline - self._clock.now()) / 1e9) > 0:
            data += self._line.receive(remaining)
            while True:
                found, data = decode(data)
                if found is None:
                    break
                if found.device != packet.device or found.instruction != STATUS or not found.parameters:
                    continue
                error, answer = found.parameters[0], found.parameters[1:]
                if error & ~ALERT and not answer:
                    self._owed = False
                    raise self._refusal(packet.device, error & ~ALERT)
                if len(answer) == size:
                    self._owed = False
                    (self.alerted.add if error & ALERT else self.alerted.discard)(packet.device)
                    return answer
        return None

    def _silent(self, device: int) -> DeviceLostError:
        return DeviceLostError(
            f"{self._line.name}: Dynamixel {device} does not answer; check its power, its cable, its id and "
            "the baud rate (57600 as delivered), then close it and open it again"
        )

    def _refusal(self, device: int, code: int) -> OperationError:
        kind = LimitError if code == LIMIT else OperationError
        return kind(
            f"{self._line.name}: Dynamixel {device} reports error {code}: {ERRORS.get(code, 'unknown')}"
        )


def _reading(device: int, address: int, size: int) -> Packet:
    return Packet(device, READ, address.to_bytes(2, "little") + size.to_bytes(2, "little"))


def _number(data: bytes) -> int:
    return int.from_bytes(data, "little", signed=True)


def _writing(device: int, address: int, *values: int) -> Packet:
    data = b"".join(value.to_bytes(4, "little", signed=True) for value in values)
    return Packet(device, WRITE, address.to_bytes(2, "little") + data)
