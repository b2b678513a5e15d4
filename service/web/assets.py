"""The page's own files, read and compressed once: what is not in this table cannot be asked for."""

import gzip
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from starlette.requests import Request
from starlette.responses import Response

_FOLDERS = {"static": "**/*", "vendor": "*"}
"""What of each is served; what only tests use lies deeper in `vendor`."""

_ROOT = Path(__file__).parent

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".ico": "image/x-icon",
    ".json": "application/json",
    ".webmanifest": "application/manifest+json",
    ".woff2": "font/woff2",
    ".txt": "text/plain; charset=utf-8",
}

_SMALL = 500
"""Bytes under which compression gains nothing."""


@dataclass(frozen=True, slots=True)
class Asset:
    """One file, `packed` by gzip where that makes it smaller."""

    kind: str
    tag: str
    content: bytes
    packed: bytes | None

    def answer(self, request: Request, status: int = 200) -> Response:
        """The response to a request for it."""
        headers = {"etag": self.tag, "cache-control": "no-cache", "vary": "accept-encoding"}
        if status == 200 and request.headers.get("if-none-match") == self.tag:
            return Response(status_code=304, headers=headers)
        content = self.content
        if self.packed is not None and "gzip" in request.headers.get("accept-encoding", ""):
            content, headers["content-encoding"] = self.packed, "gzip"
        return Response(content, status, headers, self.kind)


@cache
def assets() -> Mapping[str, Asset]:
    """Every file by its path in a URL, such as `static/app.js`."""
    found = {}
    for folder, which in _FOLDERS.items():
        for path in sorted((_ROOT / folder).glob(which)):
            if path.is_file() and path.suffix in _TYPES:
                found[path.relative_to(_ROOT).as_posix()] = _asset(path)
    return found


def _asset(path: Path) -> Asset:
    content = path.read_bytes()
    packed = gzip.compress(content, 9, mtime=0) if len(content) > _SMALL else content
    tag = f'"{hashlib.sha256(content).hexdigest()[:32]}"'
    return Asset(_TYPES[path.suffix], tag, content, packed if len(packed) < len(content) else None)
