"""The cluster that the service's bursts are sent to."""

from __future__ import annotations

from collections.abc import Iterator

from service.config.sections import Configuration
from service.doctor.check import Check
from service.errors import ClusterError

_LIMIT = 5.0
"""Seconds for the scheduler to answer."""


def check_cluster(configuration: Configuration) -> Iterator[Check]:
    """Does it answer, with workers of this version? Looked at only where `fusion.executor` names it.

    It is no problem where it does not: the service fuses by itself meanwhile.
    """
    address = configuration.fusion.cluster
    if configuration.fusion.executor != "cluster" or address is None:
        return
    from service.processes.cluster import connected, workers_of

    try:
        with connected(address, _LIMIT) as client:
            workers = workers_of(client, address, _LIMIT)
    except ClusterError as error:
        finding, _, remedy = str(error).partition("; ")
        if "pip install" in finding:
            finding, _, remedy = finding.partition(": ")
        yield Check(
            name="cluster",
            state="warning",
            finding=f"bursts are fused on this machine: {finding}",
            remedy=remedy or f"dask scheduler, and on each machine: dask worker {address} --nthreads 1",
        )
    else:
        yield Check(name="cluster", state="ok", finding=f"{address}: {workers} workers of this version")
