"""Takes frames through the real libusb and prints what came, as JSON; run by `umockdev_host.py`."""

import json
import sys
import time

import numpy as np

from drivers.errors import DeviceLostError, DriverError, OperationError
from drivers.usb import UsbCamera


def main(number: int) -> None:
    camera = UsbCamera(UsbCamera.Options(allow_inferred=True))
    camera.open()
    camera.start()
    good, wrong, errors, lost_at, recovered = 0, 0, [], None, None
    camera.grab()
    started = time.monotonic()
    while good < number:
        try:
            frame = camera.grab()
        except DeviceLostError as error:
            errors.append(str(error))
            lost_at = time.monotonic()
            reopen(camera)
            continue
        except OperationError as error:
            errors.append(str(error))
            continue
        if lost_at is not None and recovered is None:
            recovered = time.monotonic() - lost_at
        offset = int(frame.amplitude[0, 0]) - 1000
        expected = 4 * ((np.arange(25344) + offset) % 16384)
        wrong += not np.array_equal(frame.counts.ravel(), expected)
        good += 1
    seconds = time.monotonic() - started
    serial = camera.capabilities.serial
    camera.close()
    result = {"good": good, "wrong": wrong, "errors": errors, "rate": good / seconds, "serial": serial}
    print(json.dumps({**result, "recovered": recovered}))


def reopen(camera: UsbCamera) -> None:
    camera.close()
    while True:
        try:
            camera.open()
        except DriverError:
            time.sleep(0.05)
        else:
            camera.start()
            return


if __name__ == "__main__":
    main(int(sys.argv[1]))
