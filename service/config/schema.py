"""The JSON schema of the configuration file, with what each backend takes."""

from typing import Any

from drivers.backends import backend_names, camera_class, stage_class
from drivers.errors import NotAvailableError
from service.config.sections import Configuration

_KINDS = {"camera": camera_class, "stage": stage_class}


def schema() -> dict[str, Any]:
    """JSON schema of the file; the options of camera and stage follow from the backend that is named.

    A backend whose library is missing here is left out.
    """
    found = Configuration.model_json_schema()
    definitions = found["$defs"]
    for kind, named in _KINDS.items():
        section = definitions[f"{kind.capitalize()}Section"]
        backend = section["properties"]["backend"]
        section["allOf"] = []
        for name in backend_names(kind):
            try:
                options = named(name).Options
            except NotAvailableError:
                continue
            key = f"{kind.capitalize()}Options.{name}"
            own = options.model_json_schema(ref_template="#/$defs/{model}")
            definitions.update(own.pop("$defs", {}))
            definitions[key] = own
            section["allOf"].append(_where(name, key, is_default=name == backend["default"]))
        backend["examples"] = backend_names(kind)
    return found


def _where(name: str, key: str, *, is_default: bool) -> dict[str, Any]:
    """What holds where a backend is named, or left to its default."""
    named: dict[str, Any] = {"properties": {"backend": {"const": name}}}
    if not is_default:
        named["required"] = ["backend"]
    return {"if": named, "then": {"properties": {"options": {"$ref": f"#/$defs/{key}"}}}}
