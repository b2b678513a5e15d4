"""The natural order of names: 2 before 10."""

import re
from pathlib import Path


def natural(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Sorts numbers inside names by their value."""
    parts = re.split(r"(\d+)", str(path))
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], str(path)
