"""Which software this is, and what of it is installed."""

from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

from service.errors import ConfigurationError

PAGE_PACKAGES = ("starlette", "uvicorn", "websockets")
"""What the live page needs."""


def software_version() -> str:
    """Version of the installed distribution; `unknown` where the source tree is used as it is."""
    try:
        return version("lidarboost")
    except PackageNotFoundError:
        return "unknown"


def require_packages(extra: str, *modules: str) -> None:
    """Raise `ConfigurationError`, with the line that mends it, unless an extra's modules are installed."""
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise ConfigurationError(f"{', '.join(missing)} not installed: pip install 'lidarboost[{extra}]'")
