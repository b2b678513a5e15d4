"""Dynamixel X servos on a pty, as their control table describes them."""

from __future__ import annotations

from pathlib import Path

from emulators.pty_emulator import Motion, PtyEmulator

from drivers.stages.dynamixel_packets import Packet, decode, encode


class Servo:
    """The registers of one servo that a stage uses."""

    def __init__(self, speed: float) -> None:
        self.motion = Motion(speed)
        self.motion.set(2048)
        self.torque = 0
        self.mode = 3
        self.alert = False
        self.offset = 0
        """Counts by which it stays off its goal, as under load."""

    def read(self, address: int) -> int:
        return {
            11: self.mode,
            48: 4095,
            52: 0,
            64: self.torque,
            122: int(self.motion.moving),
            132: round(self.motion.position),
        }[address]

    def write(self, address: int, value: int) -> int:
        """Error code."""
        if address == 64:
            self.torque = value
        elif address == 116:
            if not 0 <= value <= 4095:
                return 6
            if self.torque:
                self.motion.go(value + self.offset)
        else:
            return 4
        return 0


class DynamixelEmulator(PtyEmulator):
    """Servos 1 (pan) and 2 (tilt).

    Args:
        speed: counts per second.
        echo: the adapter echoes what is sent, as some half-duplex ones do.
    """

    def __init__(self, link: Path | None = None, speed: float = 20_000, echo: bool = False) -> None:
        super().__init__(link)
        self.servos = {1: Servo(speed), 2: Servo(speed)}
        self._echo = echo
        self._input = b""

    def power_cycle(self) -> None:
        """Power fails and comes back: the servos have let go."""
        with self._lock:
            for servo in self.servos.values():
                servo.torque = 0
                servo.motion.stop()

    def handle(self, data: bytes) -> None:
        if self._echo:
            self.say(data)
        self._input += data
        while True:
            packet, self._input = decode(self._input)
            if packet is None:
                return
            if packet.device in self.servos:
                self.say(encode(Packet(packet.device, 0x55, self._answer(packet))))

    def _answer(self, packet: Packet) -> bytes:
        servo = self.servos[packet.device]
        alert = 0x80 if servo.alert else 0
        if packet.instruction == 1:
            return bytes([alert]) + (1060).to_bytes(2, "little") + b"\x2e"
        address = int.from_bytes(packet.parameters[:2], "little")
        if packet.instruction == 2:
            size = int.from_bytes(packet.parameters[2:4], "little")
            return bytes([alert]) + servo.read(address).to_bytes(size, "little", signed=True)
        value = int.from_bytes(packet.parameters[2:], "little", signed=True)
        return bytes([alert | servo.write(address, value)])
