"""`lidarboost settings | plan | fusion`: what is in force in a running service, and changing it."""

import json
from typing import TYPE_CHECKING, Annotated

import typer

from service.cli.commanding import AsJson, add_verb, fields_of, say
from service.cli.remote import DEFAULT_ENDPOINT, DEFAULT_PREFIX, Endpoint, Prefix, Timeout, connected

if TYPE_CHECKING:
    from pydantic import BaseModel

    from service.wire.asking import Answer


def _app(name: str, what: str, example: str) -> typer.Typer:
    app = typer.Typer(
        add_completion=False, no_args_is_help=True, help=f"Show or change {what} of a running service."
    )

    def show(answer: "Answer") -> str:
        fields = _model(name).model_fields
        lines = [
            f"{field} = {json.dumps(value)}".ljust(32) + f" # {fields[field].description}"
            for field, value in answer[name].items()
            if field in fields
        ]
        return "\n".join(lines)

    add_verb(app, f"cmd/{name}", "get", "What is in force.", 10.0, show)

    @app.command("set", help=f"Change some of it, from the next burst on; for example {example}.")
    def change(
        fields: Annotated[list[str], typer.Argument(metavar="FIELD=VALUE...", help="What is to change.")],
        endpoint: Endpoint = DEFAULT_ENDPOINT,
        prefix: Prefix = DEFAULT_PREFIX,
        timeout: Timeout = 300.0,
        as_json: AsJson = False,
    ) -> None:
        with connected(endpoint, prefix) as rig:
            say(rig.ask(f"cmd/{name}", {"action": "set"} | fields_of(fields), timeout), as_json, show)

    return app


def _model(name: str) -> "type[BaseModel]":
    from drivers.settings import CameraSettings
    from service.config.sections import FusionSettings, PlanSection

    models: dict[str, type[BaseModel]] = {
        "settings": CameraSettings,
        "plan": PlanSection,
        "fusion": FusionSettings,
    }
    return models[name]


settings = _app("settings", "the camera's settings", "integration_time=0.01")
plan = _app("plan", "the plan of poses", "span=2 axes=pan")
fusion = _app("fusion", "how frames are fused", "method=phasor")
