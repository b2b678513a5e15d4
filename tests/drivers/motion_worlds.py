"""What the tests of safe motion need of a stage on a serial line; a new backend adds itself to `WORLDS`.

Its emulator derives from `PtyEmulator` and has, besides `handle`, `tick` and `client_opened`:

- `moves`: where it was sent to, (pan, tilt) in radians, one entry whenever something makes it turn;
- `halts`: times (`now()`) at which it was told to halt;
- `moving`: whether it turns; `true_angles`: where it truly points, (pan, tilt) in radians, whatever it
  believes.

It takes its time from `self.now()`, tells answers from events (`say(…, event=True)`), and can be built before
the clock is known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

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
}
