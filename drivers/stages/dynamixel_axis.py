"""How the angle of one axis maps to the counts of one Dynamixel servo."""

from __future__ import annotations

from dataclasses import dataclass
from math import tau

from drivers.errors import InitialisationError
from drivers.stages.dynamixel_bus import Condition, Drive
from drivers.stages.serial_stage import Sign

COUNTS_PER_TURN = 4096
POSITION, EXTENDED_POSITION = 3, 4

HALF_TURN = COUNTS_PER_TURN // 2 - 12
"""Counts either way of zero in extended position mode: a degree short, so that an axis at one end, pushed
beyond it by its load, is never taken for one at the other end after its servo has lost count of its turns."""

HARDWARE_ERRORS = {
    0x01: "supply voltage",
    0x04: "overheating",
    0x08: "motor encoder",
    0x10: "electrical shock",
    0x20: "overload",
}
"""Bits of the hardware error status (70)."""


@dataclass(frozen=True, slots=True)
class Axis:
    """How one angle maps to one servo: counts = zero + sign · angle.

    Attributes:
        servo: its id.
        zero: counts at 0°, with the turns that the servo has counted.
        sign: 1 where it counts upwards to the left, or when it turns up.
        low, high: smallest and largest goal, counts.
    """

    servo: int
    zero: int
    sign: Sign
    low: int
    high: int

    def counts(self, angle: float) -> int:
        """The goal nearest to an angle in radians, of those that the servo takes."""
        return self.nearest(self.zero + self.sign * round(angle * COUNTS_PER_TURN / tau))

    def nearest(self, counts: int) -> int:
        """The goal nearest to a position."""
        return min(max(counts, self.low), self.high)

    def angle(self, counts: int) -> float:
        """Radians."""
        return self.sign * (counts - self.zero) * tau / COUNTS_PER_TURN

    @property
    def limits(self) -> tuple[float, float]:
        """Radians."""
        ends = sorted((self.angle(self.low), self.angle(self.high)))
        return ends[0], ends[1]


def make_axis(name: str, servo: int, zero: int, sign: Sign, drive: Drive, position: int) -> Axis:
    """The axis of a servo that stands at `position`, which may have lost count of its turns.

    A servo counts turns only while it has power, and starts within the turn that its encoder knows. In
    position mode nothing else is valid; in extended position mode the same place may lie a turn further.

    Raises:
        InitialisationError: another mode, or the axis has been turned further than half a turn from zero.
    """
    first = drive.homing_offset
    if drive.operating_mode == POSITION:
        turns, known = (position - first) // COUNTS_PER_TURN, range(1)
        axis = Axis(servo, zero, sign, drive.low, drive.high)
    elif drive.operating_mode == EXTENDED_POSITION:
        start = zero - COUNTS_PER_TURN // 2
        turns = (position - start) // COUNTS_PER_TURN
        last = first + COUNTS_PER_TURN - 1
        known = range((first - start) // COUNTS_PER_TURN, (last - start) // COUNTS_PER_TURN + 1)
        here = zero + turns * COUNTS_PER_TURN
        axis = Axis(servo, here, sign, here - HALF_TURN, here + HALF_TURN)
    else:
        raise InitialisationError(
            f"{name}: Dynamixel {servo} is in operating mode {drive.operating_mode}; set it to 3 (position) "
            "or 4 (extended position) with the maker's tool, torque off"
        )
    if turns not in known:
        turned = (position - zero) * 360 / COUNTS_PER_TURN
        raise InitialisationError(
            f"{name}: Dynamixel {servo} stands at {position} counts, {turned:.0f}° from its zero: "
            "it has been turned past the end of its turn; turn it back by hand and power it anew"
        )
    return axis


def check_drive(name: str, servo: int, drive: Drive, condition: Condition) -> None:
    """Raise `InitialisationError` where a servo is set up so that it cannot be driven safely."""
    if drive.profile_by_time:
        wrong = "takes its profile velocity for a time; clear bit 2 of its drive mode (10)"
    elif condition.status_return_level != 2:
        wrong = "does not answer everything; set its status return level (68) to 2"
    elif drive.velocity < 1:
        wrong = "must not move at all; set its velocity limit (44)"
    else:
        return
    raise InitialisationError(f"{name}: Dynamixel {servo} {wrong} with the maker's tool")


def hardware_error(bits: int) -> str:
    """The bits of a hardware error status in words."""
    found = [words for bit, words in HARDWARE_ERRORS.items() if bits & bit]
    return ", ".join(found) or f"status {bits}"
