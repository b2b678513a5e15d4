"""Sinks that a configuration names: installed ones, or a class in a module."""

from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from pydantic import ValidationError

from service.config.served import SinkSection
from service.errors import ConfigurationError
from service.sinks.sink import Sink

_GROUP = "lidarboost.sinks"
"""The entry point group of installed sinks."""


def configured_sinks(sections: Mapping[str, SinkSection]) -> dict[str, Callable[[], Sink]]:
    """What makes each of the sinks named, by name; all are looked up and their options checked.

    Raises:
        ConfigurationError: one that is not installed or no sink, or an option that it does not know.
    """
    return {name: _maker(name, section) for name, section in sections.items()}


def _maker(name: str, section: SinkSection) -> Callable[[], Sink]:
    kind = _class(name, section.kind)
    try:
        options = kind.Options.model_validate(section.options)
    except ValidationError as error:
        faults = "; ".join(_fault(fault) for fault in error.errors())
        known = ", ".join(kind.Options.model_fields) or "none"
        raise ConfigurationError(f"sinks.{name}.options: {faults} (it knows: {known})") from error
    return lambda: kind(options)


def _class(name: str, kind: str) -> type[Sink]:
    try:
        found = _loaded(kind)
    except (ImportError, AttributeError) as error:
        raise ConfigurationError(f"sinks.{name}.kind = {kind!r} cannot be loaded: {error}") from error
    if not (isinstance(found, type) and issubclass(found, Sink)):
        raise ConfigurationError(f"sinks.{name}.kind = {kind!r} is no Sink: {found!r}")
    return found


def _loaded(kind: str) -> Any:
    module, _, attribute = kind.partition(":")
    if attribute:
        return getattr(import_module(module), attribute)
    points = entry_points(group=_GROUP)
    if kind not in points.names:
        known = ", ".join(sorted(points.names)) or "none"
        raise ImportError(f"no sink of that name is installed (installed: {known}; or give `module:Class`)")
    return points[kind].load()


def _fault(fault: Mapping[str, Any]) -> str:
    return f"{'.'.join(map(str, fault['loc'])) or 'options'}: {fault['msg']}"
