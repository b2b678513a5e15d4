"""What the tests of safe motion need of a stage on a serial line; a new backend adds itself to `WORLDS`.

Its emulator derives from `PtyEmulator` and has, besides `handle`, `tick` and `client_opened`:

- `moves`: where it was sent to, (pan, tilt) in radians, one entry whenever something makes it turn;
- `halts`: times (`now()`) at which it was told to halt;
- `moving`: whether it turns; `true_angles`: where it truly points, (pan, tilt) in radians, whatever it
  believes.

It takes its time from `self.now()`, tells answers (`say`) from events (`announce`), and can be built before
the clock is known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from emulators.dynamixel_emulator import DynamixelEmulator
from emulators.grbl_emulator import GrblEmulator
from emulators.ptu_emulator import PtuEmulator


@dataclass(frozen=True)
class MotionWorld:
    """How a backend is tried.

    Attributes:
        backend: its name.
        device: makes an emulated device.
        options: of the stage, besides port and limits.
        accidents: what may befall the device, by name; each is given the device.
        before_home: what the operator does who consents to homing (without switches: turns it to zero).
        tolerance: radians by which a reported angle may be off.
    """

    backend: str
    device: Callable[[], Any]
    accidents: Mapping[str, Callable[[Any], None]]
    options: Mapping[str, Any] = field(default_factory=dict)
    before_home: Callable[[Any], None] = lambda _: None
    tolerance: float = 1e-3


def turned_to_zero(controller: GrblEmulator) -> None:
    """Somebody turns the axes there by hand."""
    if not controller.moving:
        controller.turn_by_hand(X=0.0, Y=0.0)


WORLDS: dict[str, MotionWorld] = {
    "ptu": MotionWorld(
        "ptu",
        PtuEmulator,
        accidents={
            "pan runs into its limit": lambda unit: unit.run_into_limit("P"),
            "tilt runs into its limit": lambda unit: unit.run_into_limit("T"),
            "power fails": PtuEmulator.power_cycle,
            "power fails and zero is lost": PtuEmulator.lose_count,
        },
    ),
    "grbl without switches": MotionWorld(
        "grbl",
        GrblEmulator,
        options={"tilt_axis": "Y"},
        accidents={
            "a limit switch closes": GrblEmulator.hit_limit,
            "the controller restarts": GrblEmulator.restart,
        },
        before_home=turned_to_zero,
    ),
    "grbl with switches": MotionWorld(
        "grbl",
        lambda: GrblEmulator(homing=True),
        options={"tilt_axis": "Y"},
        accidents={
            "a limit switch closes": GrblEmulator.hit_limit,
            "the controller restarts": GrblEmulator.restart,
        },
    ),
    "dynamixel": MotionWorld(
        "dynamixel",
        DynamixelEmulator,
        options={"tilt_id": 2},
        accidents={
            "pan is overloaded": lambda bus: bus.servos[1].shut_down(0x20),
            "power fails": DynamixelEmulator.power_cycle,
        },
        before_home=DynamixelEmulator.power_cycle,
    ),
    "dynamixel that counts turns": MotionWorld(
        "dynamixel",
        lambda: DynamixelEmulator(extended=True, zeros=(100, 2048)),
        options={"tilt_id": 2, "pan_zero": 100},
        accidents={
            "tilt overheats": lambda bus: bus.servos[2].shut_down(0x04),
            "power fails": DynamixelEmulator.power_cycle,
        },
        before_home=DynamixelEmulator.power_cycle,
    ),
}
