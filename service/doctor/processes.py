"""What other programs of this machine are doing, as far as this user may see (Linux)."""

from __future__ import annotations

import os
from pathlib import Path


def is_running(name: str) -> bool:
    """Whether a process of that name runs."""
    return any(read(file).strip() == name for file in Path("/proc").glob("[0-9]*/comm"))


def user_of(path: Path) -> str | None:
    """Another process that has the file open, as far as this user may see."""
    target = str(path.resolve())
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        try:
            if str(link.readlink()) == target and link.parent.parent.name != str(os.getpid()):
                return f"process {link.parent.parent.name} ({read(link.parent.parent / 'comm').strip()})"
        except OSError:  # gone meanwhile, or another user's
            continue
    return None


def read(path: Path) -> str:
    """The text of a file; empty where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
