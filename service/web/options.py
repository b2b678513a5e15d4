"""What the server of the live page is told."""

from pathlib import Path

from pydantic import Field

from service.config.served import WebSection
from service.wire.addresses import DEFAULT_ENDPOINT, DEFAULT_PREFIX


class PageOptions(WebSection):
    """Where the page is served, and of which rig."""

    endpoint: str = Field(DEFAULT_ENDPOINT, description="Where the service, or a router, listens.")
    prefix: str = Field(DEFAULT_PREFIX, description="What its keys begin with.")
    client: Path | None = Field(None, description="Zenoh file with certificates and the like.")

    @property
    def secret(self) -> str | None:
        """The token in clear; None = nobody is asked for one."""
        return None if self.token is None else self.token.get_secret_value()
