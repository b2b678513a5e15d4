"""A camera whose images others publish over Zenoh."""

import logging
import time
from contextlib import suppress
from functools import partial
from typing import Any

import zenoh
import zenoh.ext

from drivers.calibration import Calibration
from drivers.camera import Camera
from drivers.errors import DeviceLostError, DeviceTimeoutError, NotAvailableError, RecordingError
from drivers.frame import Frame
from drivers.remote.feed import Feed
from drivers.remote.image_feed import ImageFeed
from drivers.remote.mailbox import OPTICS, Mailbox
from drivers.remote.options import ZenohOptions
from drivers.remote.rig_feed import RigFeed
from drivers.remote.session import open_session
from drivers.settings import CameraSettings, Capabilities, recorded_settings

_TOLD = 5
"""Unusable messages that are told one by one."""

_log = logging.getLogger(__name__)


class ZenohCamera(Camera):
    """Subscribes to another rig's frames, or to depth images of ROS 2 or Foxglove.

    Open once optics and a first image have come. It cannot be set: its settings are the other side's. Images
    that came faster than they were grabbed are dropped, the oldest first, and leave a gap in the numbers.
    """

    Options = ZenohOptions
    options: ZenohOptions
    _first: Frame | None

    def _open(self) -> None:
        given = None if self.options.calibration is None else _load(self.options)
        self._feed: Feed = (
            RigFeed(self.options.prefix, given)
            if self.options.source == "lidarboost"
            else ImageFeed(self.options, given)
        )
        self._box, self._refused = Mailbox(self.clock), 0
        self._session = open_session(self.options.endpoint, self.options.config)
        try:
            self._subscribers = [self._subscribe(role, key) for role, key in self._feed.keys.items()]
            first = self._await_first()
        except BaseException:
            self._close()
            raise
        self._first, self._has_begun = first, False
        self._shape, self._heard = first.shape, time.monotonic()
        self._settings = recorded_settings(first)

    def _close(self) -> None:
        with suppress(zenoh.ZError):  # the other side may be gone
            self._session.close()  # type: ignore[no-untyped-call]

    def _start(self) -> None:
        pass

    def _stop(self) -> None:
        self._first, self._has_begun = None, False
        self._box.forget_images()

    def _grab(self, timeout: float) -> Frame:
        first, self._first = self._first, None
        if first is not None and not self._box.has_dropped and self._begins(first):
            return first
        frame = self._next(timeout)
        if frame is None:
            silent = time.monotonic() - self._heard
            if silent > self.options.silence:
                raise DeviceLostError(f"{self._feed.model}: no image came for {silent:.0f} s")
            raise DeviceTimeoutError(f"{self._feed.model}: no image came within {timeout:g} s; grab again")
        self._heard = time.monotonic()
        if frame.shape != self._shape:
            raise DeviceLostError(
                f"{self._feed.model}: images changed from {self._shape} to {frame.shape}; open it again"
            )
        return frame

    def _next(self, timeout: float) -> Frame | None:
        deadline = time.monotonic() + timeout
        while (left := deadline - time.monotonic()) > 0:
            letter = self._box.get(left)
            if letter is None:
                break
            try:
                frame = self._feed.take(letter)
            except RecordingError as error:
                self._refuse(error)
                continue
            if frame is not None and (not self._is_started or self._begins(frame)):
                return frame
        return None

    def _begins(self, frame: Frame) -> bool:
        """Whether a frame may be given: the first one must begin a burst."""
        self._has_begun = self._has_begun or frame.pose in (None, 0)
        return self._has_begun

    def _refuse(self, error: RecordingError) -> None:
        self._refused += 1
        if self._refused <= _TOLD:
            more = "; further ones are not told" if self._refused == _TOLD else ""
            _log.warning("%s: a message cannot be used: %s%s", self._feed.model, error, more)
        self._reason = str(error)

    def _await_first(self) -> Frame:
        self._reason = ""
        frame = self._next(self.options.wait)
        if frame is None:
            why = f"; lastly: {self._reason}" if self._reason else ""
            raise NotAvailableError(
                f"{self._feed.model}: within {self.options.wait:g} s there came no {self._feed.missing}{why}"
            )
        return frame

    def _subscribe(self, role: str, key: str) -> Any:
        put = partial(self._box.put, role)
        if role != OPTICS:
            return self._session.declare_subscriber(key, put)
        return zenoh.ext.declare_advanced_subscriber(
            self._session,
            key,
            put,
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
            recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
        )

    def _apply(self, settings: CameraSettings) -> CameraSettings:  # noqa: ARG002
        return self._settings

    def _calibration(self) -> Calibration:
        assert self._feed.calibration is not None
        return self._feed.calibration

    def _capabilities(self) -> Capabilities:
        return Capabilities(
            shape=self._shape, source="device", carries_pose=self._feed.carries_pose, model=self._feed.model
        )

    def _longest_exposure(self, integration_time: float | None) -> float:
        if integration_time is None:
            return self.options.exposure
        return super()._longest_exposure(integration_time)


def _load(options: ZenohOptions) -> Calibration:
    assert options.calibration is not None
    try:
        return Calibration.load(options.calibration)
    except RecordingError as error:
        raise NotAvailableError(str(error)) from error
