"""The console command: from its first instant on no signal leaves a traceback."""

from typing import NoReturn

from service.signals import note


def main() -> NoReturn:
    """Run `lidarboost`."""
    note()
    from service.cli import main as run

    run()
