"""The command line, with an SR4000 behind pyusb that is unplugged, plugged in, silent or talks again.

Usage: plugged_camera.py ARGUMENTS OF lidarboost
The words `unplug`, `replug`, `silence` and `talk`, each on a line of standard input, do so.
"""

import errno
import sys
from pathlib import Path
from threading import Thread

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "drivers")]

from usb_standin import StandIn  # noqa: E402

from drivers.mesasr import library  # noqa: E402
from drivers.usb import discovery  # noqa: E402
from service.cli import main  # noqa: E402


class Camera(StandIn):
    """Takes triggers while it is silent, but exposes nothing."""

    silent = False

    def _deliver(self, length: int, timeout: float) -> tuple[bytes, int]:
        if self.silent:
            self.queue.clear()
            self.clock.sleep(timeout)
            return b"", errno.ETIMEDOUT
        return super()._deliver(length, timeout)


camera = Camera(period=0.02, record=False)


def listen() -> None:
    for line in sys.stdin:
        word = line.strip()
        if word == "unplug":
            camera.unplug()
        elif word == "replug":
            camera.replug()
        else:
            camera.silent = word == "silence"


discovery.libusb = lambda: camera  # type: ignore[assignment]
library.FOLDERS = []
Thread(target=listen, daemon=True).start()
main()
