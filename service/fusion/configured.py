"""The executor that a configuration asks for."""

from service.config.sections import Configuration
from service.fusion.cluster import ClusterExecutor
from service.fusion.executor import Executor
from service.fusion.job import WarmUp
from service.fusion.local import LocalExecutor
from service.processes.worker import Worker
from service.versions import require_packages


def configured_executor(
    configuration: Configuration, worker: Worker | None = None, *, spare: bool = False
) -> Executor:
    """One that is ready for what the service does first.

    Args:
        configuration: names it.
        worker: the process on this machine, which may have been started already.
        spare: a second process stands ready for when that one fails.

    Raises:
        ConfigurationError: the library of a cluster is not installed.
    """
    settings = configuration.fusion
    window = configuration.stream.window if configuration.start == "stream" else None
    if settings.executor == "cluster" and settings.cluster is not None:
        require_packages("cluster", "distributed")
        local = LocalExecutor(settings, window, worker, spare=spare)
        return ClusterExecutor(local, settings.cluster, WarmUp(settings))
    return LocalExecutor(settings, window, worker, spare=spare)
