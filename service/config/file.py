"""Reads the configuration: file, environment, flags; says clearly what is wrong with them."""

import os
import re
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from reprlib import Repr
from typing import Any, ClassVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails
from pydantic_settings import BaseSettings, InitSettingsSource, PydanticBaseSettingsSource, SettingsConfigDict
from pydantic_settings.exceptions import SettingsError

from drivers.documents import parse_toml, require_plain, shortened
from service.config.presets import PRESETS
from service.config.secrets import HIDDEN, is_secret, without_secrets
from service.config.sections import Configuration
from service.errors import ConfigurationError

PREFIX = "LIDARBOOST_"
"""`LIDARBOOST_FUSION__METHOD=area` overrides `method` in section `[fusion]` of the file."""

_KUBERNETES_PORT = re.compile(r"(\w+_)?PORT(_\d+_(TCP|UDP|SCTP))?")
_KUBERNETES = re.compile(
    r"(\w+_)?(SERVICE_HOST|SERVICE_PORT(_\w+)?|PORT_\d+_(TCP|UDP|SCTP)_(PROTO|PORT|ADDR))"
)

_brief = Repr()
_brief.maxstring = _brief.maxother = 80

_NOT_CONFIGURATION = frozenset({"LIDARBOOST_DEBUG", "LIDARBOOST_ENDPOINT", "LIDARBOOST_CLIENT"})


class _PresetSource(InitSettingsSource):
    """The settings of the preset that a higher layer names."""

    def __call__(self) -> dict[str, Any]:
        return PRESETS.get(str(self.current_state.get("preset")), {})


class _Layers(BaseSettings, Configuration):
    """The four layers, highest first: flags, environment, file, the preset that one of them names."""

    document: ClassVar[dict[str, Any]] = {}

    model_config = SettingsConfigDict(env_prefix=PREFIX, env_nested_delimiter="__", env_ignore_empty=True)

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,  # noqa: ARG003
        file_secret_settings: PydanticBaseSettingsSource,  # noqa: ARG003
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        file = InitSettingsSource(settings_cls, cls.document)
        return init_settings, env_settings, file, _PresetSource(settings_cls, {})


def load(path: Path | None = None, flags: Mapping[str, Any] | None = None) -> Configuration:
    """The configuration of a file (none = defaults), overridden by the environment, then by `flags`.

    Args:
        path: TOML file.
        flags: nested like the file, for example `{"fusion": {"method": "area"}}`.

    Raises:
        ConfigurationError: cannot be read, not TOML, an unknown key, or a value out of bounds.
    """
    document = _read(path) if path is not None else {}
    _check_environment()
    layers = type("Layers", (_Layers,), {"document": document, "__module__": __name__})
    try:
        found = layers(**(flags or {}))
    except (SettingsError, RecursionError) as error:
        raise ConfigurationError(
            f"environment: {error}; sections are set key by key, as {PREFIX}FUSION__METHOD"
        ) from error
    except ValidationError as error:
        raise ConfigurationError(shortened(_faults(error, path, document, flags or {}))) from error
    for section, options in (("camera", found.camera.options), ("stage", found.stage.options)):
        try:
            require_plain(options)
        except ValueError as error:
            raise ConfigurationError(f"{section}.options {error}") from error
    return Configuration(**{name: getattr(found, name) for name in Configuration.model_fields})


def _read(path: Path) -> dict[str, Any]:
    try:
        return parse_toml(path.read_bytes())
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot read the configuration ({error.strerror})") from error
    except ValueError as error:
        raise ConfigurationError(f"{path}: {error}") from error


def _check_environment() -> None:
    """Refuse variables that name no section: the settings library passes over them in silence."""
    for name, value in os.environ.items():
        rest = name.removeprefix(PREFIX)
        is_ours = name.startswith(PREFIX) and name not in _NOT_CONFIGURATION
        if not is_ours or _is_kubernetes(rest, value):
            continue
        if rest.lower().split("__")[0] not in Configuration.model_fields:
            raise ConfigurationError(f"environment: unknown variable {name}{_nearest_variable(name)}")


def _is_kubernetes(name: str, value: str) -> bool:
    """Whether a variable tells of a Kubernetes service whose name begins with ours.

    Source: Kubernetes documentation, "Service", environment variables.
    """
    if _KUBERNETES.fullmatch(name):
        return True
    return "://" in value and _KUBERNETES_PORT.fullmatch(name) is not None


def _nearest_variable(name: str) -> str:
    """What was meant, underscores aside, or what sections there are."""
    sections = {section.upper(): section.upper() for section in Configuration.model_fields}
    keys = {
        f"{section}_{key}".upper(): f"{section}__{key}".upper()
        for section, field in Configuration.model_fields.items()
        if (model := _section(field.annotation)) is not None
        for key in model.model_fields
    }
    near = get_close_matches(name.removeprefix(PREFIX).replace("__", "_"), keys | sections, n=1)
    if near:
        return f"; did you mean {PREFIX}{(keys | sections)[near[0]]}?"
    return f"; known here: {', '.join(PREFIX + section for section in sections)}"


def _faults(
    error: ValidationError, path: Path | None, document: Mapping[str, Any], flags: Mapping[str, Any]
) -> Iterator[str]:
    """One clause per faulty key (a value that fits none of several types counts once)."""
    seen = set()
    for fault in error.errors(include_url=False):
        keys, model = _walk(fault["loc"])
        if keys not in seen:
            seen.add(keys)
            yield f"{_origin(keys, path, document, flags)}: {_words(fault, keys, model)}"


def _words(fault: ErrorDetails, keys: tuple[str, ...], model: type[BaseModel]) -> str:
    name = ".".join(keys)
    if fault["type"] == "extra_forbidden":
        return f"unknown key {name}{_nearest(keys[-1], list(model.model_fields), '.'.join(keys[:-1]))}"
    field = model.model_fields.get(keys[-1])
    meaning = f" ({field.description})" if field is not None and field.description else ""
    hidden = any(map(is_secret, keys))
    given = HIDDEN if hidden else _brief.repr(without_secrets(fault["input"]))
    return f"{name} = {given}: {fault['msg']}{meaning}"


def _walk(location: tuple[int | str, ...]) -> tuple[tuple[str, ...], type[BaseModel]]:
    """The keys of an error's location without what the validator adds to them, and the model they end in."""
    model: type[BaseModel] = Configuration
    keys: list[str] = []
    for step in location:
        keys.append(str(step))
        field = model.model_fields.get(str(step))
        inner = None if field is None else _section(field.annotation)
        if inner is None:
            break
        model = inner
    return tuple(keys), model


def _section(annotation: Any) -> type[BaseModel] | None:
    choices = (annotation, *get_args(annotation))
    return next((c for c in choices if isinstance(c, type) and issubclass(c, BaseModel)), None)


def _origin(
    keys: tuple[str, ...], path: Path | None, document: Mapping[str, Any], flags: Mapping[str, Any]
) -> str:
    if _holds(flags, keys):
        return "command line"
    variable = PREFIX + "__".join(keys).upper()
    if any(name.upper() == variable for name in os.environ):
        return f"environment variable {variable}"
    return str(path) if path is not None and _holds(document, keys) else "configuration"


def _holds(layer: Any, keys: tuple[str, ...]) -> bool:
    for key in keys:
        if not isinstance(layer, Mapping) or key not in layer:
            return False
        layer = layer[key]
    return True


def _nearest(name: str, known: list[str], section: str = "") -> str:
    prefix = f"{section}." if section else ""
    near = get_close_matches(name, known, n=1)
    if near:
        return f"; did you mean {prefix}{near[0]}?"
    return f"; known here: {', '.join(known)}"
