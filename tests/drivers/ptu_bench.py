"""A pan-tilt unit on a line in virtual time, and the stage that speaks to it."""

from unittest.mock import patch

from emulators.ptu_emulator import PtuEmulator
from emulators.virtual_line import VirtualLine

from drivers.backends import make_stage
from drivers.clock import VirtualClock


class Bench:
    """A unit on a line in virtual time."""

    def __init__(self, **unit):
        self.clock = VirtualClock(10**9)
        self.unit = PtuEmulator(**unit)
        self.line = VirtualLine(self.unit, self.clock, {})
        self.stage = None

    def open(self, **options):
        self.stage = make_stage("ptu", {"port": "virtual", **options}, self.clock)
        with patch("serial.serial_for_url", self.line.open):
            self.stage.open()
        return self.stage

    def reopen(self):
        self.stage.close()
        with patch("serial.serial_for_url", self.line.open):
            self.stage.open()

    def next_answers(self, *faults):
        """What becomes of the answers that come next."""
        for number, fault in enumerate(faults):
            self.line.faults[self.line.answers + number] = fault
