"""The sections on what the service serves: page, metrics, viewers, nodes of ROS 2, log, further sinks."""

from ipaddress import ip_address
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, SecretStr, field_validator, model_validator

from service.config.section import Section


class WebSection(Section):
    """The live page."""

    enabled: bool = Field(False, description="Serve it beside the service, in a process of its own.")
    host: str = Field(
        "127.0.0.1",
        min_length=1,
        max_length=255,
        description="Address to listen on; one that others can reach needs a token.",
    )
    port: int = Field(8470, ge=0, le=65535, description="Port to listen on; 0 = any that is free.")
    token: SecretStr | None = Field(
        None,
        description="What whoever opens the page has to know, 12 to 200 characters; none = nobody is asked.",
    )

    @property
    def is_loopback(self) -> bool:
        """Whether only programs of this machine can reach it."""
        if self.host == "localhost":
            return True
        try:
            return ip_address(self.host).is_loopback
        except ValueError:  # a name, which may mean any address
            return False

    @field_validator("token")
    @classmethod
    def _hard_to_guess(cls, token: SecretStr | None) -> SecretStr | None:
        told = None if token is None else token.get_secret_value()
        if told is not None and not (12 <= len(told) <= 200 and told.isascii() and told.isprintable()):
            raise ValueError("expected 12 to 200 printable ASCII characters")
        return token

    @model_validator(mode="after")
    def _open_to_others_by_token(self) -> Self:
        if self.token is None and not self.is_loopback:
            raise ValueError(f"host {self.host} can be reached by others: set web.token, or host 127.0.0.1")
        return self


class MetricsSection(Section):
    """Metrics, and whether the service is alive and ready, by HTTP on this machine alone."""

    enabled: bool = Field(
        False, description="Serve /metrics (Prometheus), /healthz and /readyz; needs lidarboost[metrics]."
    )
    port: int = Field(9464, ge=0, le=65535, description="TCP port on 127.0.0.1; 0 = any that is free.")


class Ros2Section(Section):
    """The service as a node of ROS 2 under rmw_zenoh; needs lidarboost[ros2]."""

    enabled: bool = Field(False, description="Appear to ROS 2 nodes.")
    domain: int = Field(0, ge=0, le=232, description="ROS_DOMAIN_ID.")
    namespace: str = Field(
        "/lidarboost",
        pattern=r"^(/|(/[A-Za-z_][A-Za-z0-9_]*)+)$",
        description="What the names of node and topics begin with; / = nothing.",
    )
    distribution: Literal["humble", "iron", "jazzy", "kilted", "lyrical"] = Field(
        "jazzy", description="Of the nodes that listen."
    )
    config: Path | None = Field(
        None,
        description="Zenoh's own JSON5 file for this session; none = reached where the service listens.",
    )


class FoxgloveSection(Section):
    """A server for Foxglove and Lichtblick."""

    enabled: bool = Field(False, description="Serve viewers; needs lidarboost[foxglove].")
    host: str = Field(
        "127.0.0.1",
        min_length=1,
        description="Address to listen on; beyond loopback anybody may look.",
    )
    port: int = Field(8765, ge=0, le=65535, description="TCP port; 0 = any that is free.")


class LogSection(Section):
    """How the service says what happens, on standard output."""

    format: Literal["text", "json"] = Field("text", description="Lines to read, or a JSON object a line.")


class SinkSection(Section):
    """One more that takes the events of the service."""

    kind: str = Field(
        min_length=1,
        description="An installed sink, or the class itself as `module:Class`; see CONTRIBUTING.md.",
    )
    options: dict[str, Any] = Field({}, description="Options of the sink itself; it checks them.")
