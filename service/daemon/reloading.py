"""Reads the configuration again while the service runs, and puts in force what can be changed meanwhile."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from drivers.errors import DriverError
from service.capture.configured import check_options
from service.config.sections import Configuration
from service.daemon.recording import begin_recorder
from service.daemon.renewal import reconfigure
from service.errors import InvalidStateError, ServiceError, UnavailableError
from service.sinks.recorder import RECORDER, Recorder, order_of, wish_of
from service.sinks.recording_order import Wish

if TYPE_CHECKING:
    from service.daemon.daemon import Daemon

_LIVE = (
    "plan",
    "fusion",
    "stream",
    "recording",
    "camera.settings",
    "camera.timeout",
    "stage.settle",
    "stage.timeout",
)
"""What can be changed while the service runs: sections, and fields of others."""

_FIXED = {"fusion": ("executor", "cluster")}
"""What cannot, of these sections."""

_RETRY = 0.5
"""Seconds after which a rig that is lost, or paused, is asked again."""

_PART = "configuration"

_log = logging.getLogger(__name__)


class Reloading:
    """Reloads on request; one that is asked for while another is at work follows it.

    Args:
        daemon: at work.
        read: reads the configuration anew; raises `ConfigurationError`.
    """

    def __init__(self, daemon: Daemon, read: Callable[[], Configuration]) -> None:
        self._daemon, self._read = daemon, read
        self._lock = Lock()

    def begin(self) -> None:
        """Reload in a thread of its own."""
        Thread(target=self._run, name="reloading", daemon=True).start()

    def _run(self) -> None:
        with self._lock:
            try:
                self.reload()
            except (ServiceError, DriverError) as error:
                what = f"the configuration was not reloaded: {error}"
                _log.error("%s; what was in force still is", what)
                self._daemon.states.degrade(_PART, what, "mend it, then reload it again")
            else:
                self._daemon.states.mend(_PART)

    def reload(self) -> None:
        """Read it, and have what has changed put in force with the next burst; says what that is.

        What was set by command is dropped. What needs a restart is named, and stays as it is.

        Raises:
            ConfigurationError: it cannot be used; nothing has changed.
            DriverError: the camera refuses its settings; nothing has changed.
        """
        wanted = self._read()
        check_options(wanted)
        before = self._daemon.configuration
        changed = list(_differences(before, wanted))
        live = [key for key in changed if _is_live(key)]
        later = [key for key in changed if not _is_live(key)]
        self._put_in_force(_merged(before, wanted))
        if before.recording != wanted.recording:
            begin_recorder(self._daemon.bus, wanted.recording, self._wish(before, wanted))
        _log.info(
            "the configuration was reloaded: %s%s",
            f"changed: {', '.join(live)}" if live else "nothing in force has changed",
            f"; needs a restart: {', '.join(later)}" if later else "",
        )

    def _wish(self, before: Configuration, wanted: Configuration) -> Wish | None:
        """What is recorded then: as configured where that has changed, else as it was."""
        recorder = self._daemon.bus.sink(RECORDER)
        if before.recording.enabled == wanted.recording.enabled and isinstance(recorder, Recorder):
            wish = recorder.order.wish
            return None if wish is None else wish_of(wanted.recording)
        return order_of(wanted.recording).wish

    def _put_in_force(self, wanted: Configuration) -> None:
        """Have the owner of the devices do it, as soon as it can."""
        daemon = self._daemon
        while not daemon.stop.is_set():
            try:
                daemon.control.inbox.submit(lambda: self._apply(wanted), "burst").result()
                return
            except (UnavailableError, InvalidStateError):  # a device is lost, or the scan is paused
                daemon.stop.wait(_RETRY)

    def _apply(self, wanted: Configuration) -> None:
        daemon, rig = self._daemon, self._daemon.rig
        before = rig.camera.settings
        settings = wanted.camera.settings or rig.found
        if settings is not None and settings != before:
            rig.apply(settings)
        try:
            sections = {name: getattr(wanted, name) for name in Configuration.model_fields}
            reconfigure(daemon, **{n: one for n, one in sections.items() if isinstance(one, BaseModel)})
        except BaseException:
            if rig.camera.settings != before:
                rig.apply(before)
            raise
        daemon.grabber.timeout = wanted.camera.timeout


def _is_live(key: str) -> bool:
    section, _, field = key.partition(".")
    return key.startswith(_LIVE) and field not in _FIXED.get(section, ())


def _merged(before: Configuration, wanted: Configuration) -> Configuration:
    """What was in force, with what can be changed as it is wanted."""
    merged = before
    for key in _LIVE:
        section, _, field = key.partition(".")
        value = getattr(wanted, section)
        update = {name: getattr(getattr(before, section), name) for name in _FIXED.get(section, ())}
        if field:
            update, value = {field: getattr(value, field)}, getattr(merged, section)
        merged = merged.model_copy(update={section: value.model_copy(update=update)})
    return merged


def _differences(before: BaseModel, after: BaseModel, name: str = "") -> Iterator[str]:
    """The names of all fields that are not the same."""
    for field in type(after).model_fields:
        one: Any = getattr(before, field)
        other: Any = getattr(after, field)
        if one == other:
            continue
        if isinstance(one, BaseModel) and isinstance(other, BaseModel):
            yield from _differences(one, other, f"{name}{field}.")
        else:
            yield f"{name}{field}"
