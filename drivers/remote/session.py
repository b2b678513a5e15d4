"""A Zenoh session that connects to one place and listens nowhere."""

import json
import re
from pathlib import Path

import zenoh

from drivers.errors import NotAvailableError


def open_session(endpoint: str | None, config: Path | None) -> zenoh.Session:
    """A client of an endpoint, or what a Zenoh file says.

    Raises:
        NotAvailableError: the file cannot be read, or nobody listens there.
    """
    try:
        if config is not None:
            return zenoh.open(zenoh.Config.from_file(config))
        settings = zenoh.Config()
        settings.insert_json5("mode", '"client"')
        settings.insert_json5("scouting/multicast/enabled", "false")
        settings.insert_json5("connect/endpoints", json.dumps([endpoint]))
        return zenoh.open(settings)
    except (zenoh.ZError, OSError) as error:
        where = endpoint if config is None else config
        raise NotAvailableError(
            f"{where}: no Zenoh session ({_brief(str(error))}); does the other side run, and listen there?"
        ) from error


def _brief(error: str) -> str:
    return " ".join(re.sub(r" at /\S+\.rs:\d+\.?", "", error).split())
