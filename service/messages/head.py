"""What a recording begins with."""

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Head:
    """Metadata, and attachments as (name, data, media type)."""

    metadata: dict[str, str] = field(default_factory=dict)
    attachments: tuple[tuple[str, bytes, str], ...] = ()
