"""The executor that a configuration asks for."""

from service.config.sections import Configuration
from service.fusion.cluster import ClusterExecutor
from service.fusion.executor import Executor
from service.fusion.job import WarmUp
from service.fusion.local import LocalExecutor
from service.processes.worker import Worker
from service.versions import require_packages


def configured_executor(configuration: Configuration, worker: Worker | None = None) -> Executor:
    """One that is ready for what the service does first.

    Args:
        configuration: names it.
        worker: the process on this machine, which may have been started already.

    Raises:
        ConfigurationError: the library of a cluster is not installed.
    """
    settings = configuration.fusion
    window = configuration.stream.window if configuration.start == "stream" else None
    if settings.executor == "local" or settings.cluster is None:
        return LocalExecutor(settings, window, worker)
    require_packages("cluster", "distributed")
    return ClusterExecutor(LocalExecutor(settings, window, worker), settings.cluster, WarmUp(settings))
