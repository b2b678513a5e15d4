"""Names of files, which may hold bytes that are no text."""

from typing import Annotated

from pydantic import BeforeValidator


def shown(name: object) -> str:
    """A path, or what holds one, as text that can be written: bytes of it that are no text are replaced."""
    return str(name).encode(errors="surrogateescape").decode(errors="replace")


Shown = Annotated[str, BeforeValidator(shown)]
"""Text that may hold the name of a file."""
