"""The live page of a rig, by itself."""

import os
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

if TYPE_CHECKING:
    from service.web.options import PageOptions


def serve_page(**given: Any) -> None:
    """Serve it until told to stop; `given` are the `PageOptions`."""
    from service.signals import stopping
    from service.versions import PAGE_PACKAGES, require_packages

    require_packages("web", *PAGE_PACKAGES)
    from service.web.server import PageServer

    options = _options(given | {"client": os.environ.get("LIDARBOOST_CLIENT") or None})
    with stopping() as signals, PageServer(options) as page:
        signals.stops(page.stop)
        secret = "" if options.secret is None else f"?token={quote(options.secret, safe='')}"
        print(f"page: {page.url}{secret}", flush=True)
        while not page.wait(1.0):
            pass


def _options(given: dict[str, Any]) -> "PageOptions":
    from pydantic import ValidationError

    from service.errors import ConfigurationError
    from service.web.options import PageOptions

    try:
        return PageOptions.model_validate(given)
    except ValidationError as error:
        faults = error.errors(include_url=False, include_input=False)
        said = "; ".join(
            f"--{fault['loc'][0]}: {fault['msg']}" if fault["loc"] else fault["msg"] for fault in faults
        )
        raise ConfigurationError(said.replace("web.token", "--token")) from error
