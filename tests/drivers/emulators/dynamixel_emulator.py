"""Dynamixel X servos, as their manual describes them (emanual.robotis.com/docs/en/dxl/x/xl430-w250)."""

from __future__ import annotations

from collections.abc import Iterable
from math import tau
from pathlib import Path

from emulators.pty_emulator import PtyEmulator

from drivers.stages.dynamixel_packets import Packet, decode, encode

COUNTS_PER_SECOND = 0.229 * 4096 / 60
"""In one unit of the profile velocity."""

STILL = 10
"""Counts that a goal may be off the position without meaning a movement."""

BRAKING = 30
"""Counts on its way that a halt may take: 2.6°."""

AS_FAST_AS_IT_CAN = 60
"""Profile velocity that a profile velocity of 0 amounts to."""


class Servo:
    """The registers of one servo that a stage uses.

    Attributes:
        true: where its axis really is, in counts, with every turn of its cable.
        fastest: the highest profile velocity that it has moved at.
        offset: counts by which it stays off its goal, as under load.
    """

    def __init__(self, now) -> None:
        self._now = now
        self.mode, self.drive_mode, self.homing_offset = 3, 0, 0
        self.velocity_limit, self.low, self.high = 265, 0, 4095
        self.status_return_level, self.hardware_error = 2, 0
        self.torque_at_start = False
        self.offset = self.fastest = 0
        self._from = self._to = 2048.0
        self._at, self._speed = 0.0, 1.0
        self.power_up()

    @property
    def true(self) -> float:
        travelled = (self._now() - self._at) * self._speed
        distance = self._to - self._from
        return (
            self._to if travelled >= abs(distance) else self._from + travelled * (1 if distance > 0 else -1)
        )

    @property
    def moving(self) -> bool:
        return self.true != self._to

    @property
    def present(self) -> int:
        """What it reports: its turns count from where it was powered."""
        return round(self.true) + self._turns

    @property
    def true_goal(self) -> float:
        """Its goal, with every turn of the cable."""
        return self.goal - self._turns

    def power_up(self) -> None:
        """Power comes (back): it has let go, and knows its place within a turn only."""
        self.turn_by_hand(self.true)
        self.torque, self.hardware_error = int(self.torque_at_start), 0
        self.acceleration = self.velocity = 0
        self._forget_turns()
        self.goal = self.present

    def _forget_turns(self) -> None:
        self._turns = round(self.true) % 4096 + self.homing_offset - round(self.true)

    def turn_by_hand(self, true: float) -> None:
        """Somebody turns the axis, which is limp."""
        self._from = self._to = true

    def shut_down(self, error: int) -> None:
        """It protects itself: an alert, and its torque is gone."""
        self.hardware_error = error
        self.turn_by_hand(self.true)
        self.torque = 0

    def read(self, address: int, size: int) -> bytes:
        table = bytearray(148)
        for at, width, value in (
            (10, 1, self.drive_mode),
            (11, 1, self.mode),
            (20, 4, self.homing_offset),
            (44, 4, self.velocity_limit),
            (48, 4, self.high),
            (52, 4, self.low),
            (64, 1, self.torque),
            (68, 1, self.status_return_level),
            (70, 1, self.hardware_error),
            (108, 4, self.acceleration),
            (112, 4, self.velocity),
            (116, 4, self.goal),
            (120, 2, round(self._now() * 1000) % 32768),
            (122, 1, int(self.moving)),
            (132, 4, self.present),
        ):
            table[at : at + width] = value.to_bytes(width, "little", signed=value < 0)
        return bytes(table[address : address + size])

    def write(self, address: int, data: bytes) -> int:
        """Error code."""
        if address == 64:
            if self.hardware_error and data[0]:
                return 7
            if data[0] and not self.torque and self.mode == 3:
                self._forget_turns()
            self.torque = data[0]
            self._follow()
        elif address == 108 and len(data) == 12:
            acceleration, velocity, goal = (
                int.from_bytes(data[at : at + 4], "little", signed=True) for at in (0, 4, 8)
            )
            if self.mode == 3 and not self.low <= goal <= self.high:
                return 6
            self.acceleration, self.velocity, self.goal = acceleration, velocity, goal
            self._follow()
        else:
            return 4
        return 0

    def _follow(self) -> None:
        if not self.torque:
            return
        velocity = self.velocity or AS_FAST_AS_IT_CAN
        self._from, self._at = self.true, self._now()
        self._to = float(self.true_goal + self.offset)
        self._speed = velocity * COUNTS_PER_SECOND
        if self._from != self._to:
            self.fastest = max(self.fastest, velocity)


class DynamixelEmulator(PtyEmulator):
    """Servos 1 (pan) and 2 (tilt).

    Args:
        echo: the adapter echoes what is sent, as some half-duplex ones do.
        extended: the servos are in extended position mode.
        zeros: where their axes point to 0°, counts.

    Attributes:
        written: (servo, address, data) of each write that was carried out.
        goals: (servo, true counts) of each goal that was written.
        moves: where it was sent to, true angles in radians.
        halts: when it was told to halt.
    """

    def __init__(
        self,
        link: Path | None = None,
        echo: bool = False,
        extended: bool = False,
        zeros: tuple[int, int] = (2048, 2048),
    ) -> None:
        super().__init__(link)
        self.servos = {1: Servo(lambda: self.now()), 2: Servo(lambda: self.now())}
        self.written: list[tuple[int, int, bytes]] = []
        self.goals: list[tuple[int, float]] = []
        self.moves: list[tuple[float, float]] = []
        self.halts: list[float] = []
        self._echo, self._zeros = echo, zeros
        self._input = b""
        for servo, zero in zip(self.servos.values(), zeros, strict=True):
            servo.mode = 4 if extended else 3
            servo.turn_by_hand(zero)
            servo.power_up()

    @property
    def moving(self) -> bool:
        return any(servo.moving for servo in self.servos.values())

    @property
    def true_angles(self) -> tuple[float, float]:
        """Where the axes really point, radians."""
        return self._angles(servo.true for servo in self.servos.values())

    def _angles(self, counts: Iterable[float]) -> tuple[float, float]:
        pan, tilt = ((at - zero) * tau / 4096 for at, zero in zip(counts, self._zeros, strict=True))
        return pan, tilt

    def power_cycle(self) -> None:
        """Power fails and comes back: the servos have let go."""
        for servo in self.servos.values():
            servo.power_up()

    def handle(self, data: bytes) -> None:
        if self._echo:
            self.say(data)
        self._input += data
        while True:
            packet, self._input = decode(self._input)
            if packet is None:
                return
            if packet.device in self.servos:
                answer = self._answer(packet)
                if answer is not None:
                    self.say(encode(Packet(packet.device, 0x55, answer)))

    def _note(self, servo: Servo, moving: bool, at: float, goal: float) -> None:
        """Whether a goal sets it in motion, or ends one: at once, or a little further on its way."""
        rest = servo.true_goal - at
        on_its_way = rest * (goal - at) > 0 and abs(rest) <= min(BRAKING, abs(goal - at))
        if abs(rest) > STILL and not (moving and on_its_way):
            if servo.moving:
                self.moves.append(self._angles(one.true_goal for one in self.servos.values()))
        elif moving:
            self.halts.append(self.now())

    def _answer(self, packet: Packet) -> bytes | None:
        servo = self.servos[packet.device]
        alert = 0x80 if servo.hardware_error else 0
        if packet.instruction == 1:
            return bytes([alert]) + (1060).to_bytes(2, "little") + b"\x2e"
        address = int.from_bytes(packet.parameters[:2], "little")
        if packet.instruction == 2:
            size = int.from_bytes(packet.parameters[2:4], "little")
            return bytes([alert]) + servo.read(address, size)
        moving, before, after = servo.moving, servo.true, servo.true_goal
        error = servo.write(address, packet.parameters[2:])
        if not error:
            self.written.append((packet.device, address, packet.parameters[2:]))
            if address == 108:
                self.goals.append((packet.device, servo.true_goal))
            self._note(servo, moving, before, after)
        return None if servo.status_return_level < 2 else bytes([alert | error])
