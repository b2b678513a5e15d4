"""A Grbl controller in virtual time, and a stage on it."""

from math import radians

from emulators.grbl_emulator import GrblEmulator
from emulators.watched_line import WatchedLine

from drivers.backends import make_stage
from drivers.clock import VirtualClock

STEP = radians(1 / 160)
"""One of the emulated controller's steps."""


class GrblRig:
    """A controller in virtual time, and a stage on it."""

    def __init__(self, monkeypatch):
        self.clock = VirtualClock()
        self._monkeypatch = monkeypatch
        self.fit()

    def fit(self, homing=False):
        self.grbl = GrblEmulator(homing=homing)
        self.line = WatchedLine(self.grbl, self.clock)
        self._monkeypatch.setattr("serial.serial_for_url", self.line.open)

    def stage(self, **options):
        stage = make_stage("grbl", {"port": "virtual", "tilt_axis": "Y", **options}, self.clock)
        stage.open()
        return stage

    def homed(self, **options):
        stage = self.stage(**options)
        stage.home()
        return stage

    def sent_since(self, at):
        return [data for when, data in self.line.writes if when >= at]
