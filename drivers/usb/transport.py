"""One opened camera on the bus: claims it, and lets only the profile's own transfers through."""

import errno
import logging
from array import array
from typing import NoReturn

import usb.core
import usb.util

from drivers.clock import Clock
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    DriverError,
    InitialisationError,
    NotAvailableError,
    OperationError,
)
from drivers.usb.discovery import UsbDevice
from drivers.usb.profile import Profile, usable
from drivers.usb.steps import Control, Read, RegisterWrite, Step, Write

log = logging.getLogger(__name__)

CALL_TIMEOUT = 1000
"""Milliseconds allowed to one transfer, as in the CSEM driver."""

POLL_TIMEOUT = 5.0
"""Seconds in which a polled request must give the answer that it gave in the trace."""

POLL_PAUSE = 0.01
"""Seconds between two polls."""

GONE = frozenset({errno.ENODEV, errno.ESHUTDOWN})


class StallError(OperationError):
    """An endpoint refused a transfer (it is halted)."""


class Transport:
    """A claimed interface of a camera.

    Args:
        device: the camera.
        profile: what may be sent to it.
        allow_inferred: whether the profile's unsure entries may be used.
        clock: used for the pauses that a profile asks for.

    Raises:
        NotAvailableError: no permission, or another program holds it.
        InitialisationError: the interface or its endpoints are not those of the profile.
        DeviceLostError: unplugged meanwhile.
    """

    def __init__(self, device: UsbDevice, profile: Profile, allow_inferred: bool, clock: Clock) -> None:
        self._device = device
        self._usb = device.handle
        self._profile = profile
        self._clock = clock
        self._interface = profile.interface.known
        self._bulk_in = profile.bulk_in.known
        self._bulk_out = profile.bulk_out.known
        self._permitted = _permitted_steps(profile, allow_inferred)
        self._registers = _permitted_registers(profile, allow_inferred)
        self._reattach = False
        try:
            self._claim(allow_inferred)
        except BaseException:
            self.release()
            raise

    def run(self, steps: tuple[Step, ...]) -> None:
        """Send a sequence of the profile, in order."""
        for step in steps:
            self._clock.sleep(step.pause)
            self.send(step)

    def send(self, step: Step) -> None:
        """Send one transfer, if the profile lists it. This is the only place that sends anything.

        Raises:
            OperationError: the profile does not list it, or the camera refused it.
            DeviceTimeoutError: no answer.
            DeviceLostError: unplugged.
        """
        self._check(step)
        try:
            if isinstance(step, Control):
                self._control(step)
            elif isinstance(step, Read):
                self._usb.read(step.endpoint, step.length, CALL_TIMEOUT)
            elif isinstance(step, Write):
                self._sent(step, self._usb.write(step.endpoint, step.data, CALL_TIMEOUT), len(step.data))
            else:
                sent = self._usb.write(self._bulk_out, bytes((step.number, step.value)), CALL_TIMEOUT)
                self._sent(step, sent, 2)
        except usb.core.USBError as error:
            self._fail(str(step), error)

    def read_into(self, buffer: "array[int]", timeout: float) -> int:
        """Fill a buffer from the image endpoint; returns how many bytes came within `timeout` seconds.

        Raises:
            DeviceTimeoutError: none came.
            StallError: the endpoint is halted.
            DeviceLostError, OperationError: as `send`.
        """
        try:
            # libusb takes 0 as "for ever"
            return int(self._usb.read(self._bulk_in, buffer, max(1, round(timeout * 1000))))
        except usb.core.USBError as error:
            self._fail("reading an image", error)

    def clear_halt(self) -> None:
        """Take the image endpoint out of its halt."""
        try:
            self._usb.clear_halt(self._bulk_in)
        except usb.core.USBError as error:
            self._fail("clearing the halt of the image endpoint", error)

    def release(self) -> None:
        """Give the interface back; never raises, whatever became of the camera."""
        try:
            usb.util.release_interface(self._usb, self._interface)
            if self._reattach:
                self._usb.attach_kernel_driver(self._interface)
        except (usb.core.USBError, NotImplementedError, ValueError) as error:
            log.debug("releasing %s: %s", self._device, error)
        finally:
            usb.util.dispose_resources(self._usb)

    def _check(self, step: Step) -> None:
        if step in self._permitted or (isinstance(step, RegisterWrite) and step.number in self._registers):
            return
        raise OperationError(
            f"{step} is not in the profile of the {self._profile.model}, so it was not sent: "
            "unknown requests can erase a camera's flash"
        )

    def _control(self, step: Control) -> None:
        if not step.reads:
            sent = self._usb.ctrl_transfer(
                step.request_type, step.request, step.value, step.index, step.data, CALL_TIMEOUT
            )
            self._sent(step, sent, len(step.data))
            return
        deadline = self._clock.now() + POLL_TIMEOUT * 1e9
        while True:
            answer = bytes(
                self._usb.ctrl_transfer(
                    step.request_type, step.request, step.value, step.index, step.length, CALL_TIMEOUT
                )
            )
            if step.until is None or answer == step.until:
                return
            if self._clock.now() > deadline:
                raise OperationError(
                    f"{step}: the camera answers {answer.hex()}, expected {step.until.hex()} as in the trace"
                )
            self._clock.sleep(POLL_PAUSE)

    def _sent(self, step: Step, sent: int, expected: int) -> None:
        if sent != expected:
            raise OperationError(f"{step}: the camera took {sent} of {expected} bytes")

    def _claim(self, allow_inferred: bool) -> None:
        try:
            self._detach_kernel_driver()
            self._configure(allow_inferred)
            usb.util.claim_interface(self._usb, self._interface)
            self._check_endpoints()
        except usb.core.USBError as error:
            self._fail("opening", error)

    def _detach_kernel_driver(self) -> None:
        try:
            if self._usb.is_kernel_driver_active(self._interface):
                self._usb.detach_kernel_driver(self._interface)
                self._reattach = True
        except NotImplementedError:  # libusb on Windows and macOS has no kernel drivers to detach
            pass

    def _configure(self, allow_inferred: bool) -> None:
        try:
            self._usb.get_active_configuration()
        except usb.core.USBError as error:
            if error.errno is not None:
                raise
            configuration = self._profile.configuration
            if not usable(configuration, allow_inferred):
                raise InitialisationError(
                    f"{self._device} is not configured, and which configuration it needs is "
                    f"{configuration.confidence}: {configuration.source}"
                ) from error
            self._usb.set_configuration(configuration.known)

    def _check_endpoints(self) -> None:
        configuration = self._usb.get_active_configuration()
        there = {
            endpoint.bEndpointAddress
            for interface in configuration
            if interface.bInterfaceNumber == self._interface
            for endpoint in interface
        }
        if missing := {self._bulk_in, self._bulk_out} - there:
            raise InitialisationError(
                f"{self._device}: interface {self._interface} has the endpoints {_hex(there)}, the profile "
                f"needs {_hex(missing)} too; record a trace and run `lidarboost devices learn`"
            )

    def _fail(self, action: str, error: usb.core.USBError) -> NoReturn:
        raise self._translate(action, error) from error

    def _translate(self, action: str, error: usb.core.USBError) -> DriverError:
        where = f"{self._device}: {action}"
        if isinstance(error, usb.core.USBTimeoutError) or error.errno == errno.ETIMEDOUT:
            return DeviceTimeoutError(f"{where}: no answer in time")
        if error.errno in GONE:
            return DeviceLostError(f"{where}: the camera was unplugged or lost power")
        if error.errno == errno.EACCES:
            return NotAvailableError(
                f"{where}: no permission for {self._device.node}. Write this line to "
                f"/etc/udev/rules.d/60-lidarboost.rules, run `sudo udevadm control --reload`, and plug the "
                f"camera in again: {self._device.udev_rule}"
            )
        if error.errno == errno.EBUSY:
            return NotAvailableError(f"{where}: another program holds the camera; end it first")
        if error.errno == errno.EPIPE:
            return StallError(f"{where}: the camera refused the transfer (stall)")
        return OperationError(f"{where}: {error}")


def _permitted_steps(profile: Profile, allow_inferred: bool) -> frozenset[Step]:
    sequences = (profile.initialise, profile.trigger, profile.finish)
    return frozenset(step for fact in sequences if usable(fact, allow_inferred) for step in fact.known)


def _permitted_registers(profile: Profile, allow_inferred: bool) -> frozenset[int]:
    known = profile.registers
    numbers: list[int] = []
    if usable(known.integration_time, allow_inferred):
        numbers.append(known.integration_time.known)
    if usable(known.amplitude_threshold, allow_inferred):
        numbers.extend(known.amplitude_threshold.known)
    return frozenset(numbers)


def _hex(addresses: set[int]) -> str:
    return ", ".join(f"0x{address:02x}" for address in sorted(addresses)) or "none"
