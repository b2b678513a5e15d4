"""A daemon whose bursts a cluster fuses: what the status says when it goes away and comes back."""

import sys
from pathlib import Path

import pytest
from daemons import ROOT, daemon, ear, wait_until

sys.path.append(str(ROOT / "tests" / "service"))
from dask_cluster import dask_cluster

pytestmark = pytest.mark.slow


def test_the_status_says_who_fuses_and_no_burst_is_lost(tmp_path: Path) -> None:
    with dask_cluster(tmp_path / "dask", 1) as cluster:
        place = {
            "LIDARBOOST_FUSION__EXECUTOR": "cluster",
            "LIDARBOOST_FUSION__CLUSTER": cluster.address,
            "LIDARBOOST_FUSION__BACKLOG": "100",
        }
        with daemon(tmp_path, environment=place) as service, ear(service.endpoint) as heard:

            def fuses(who: str) -> bool:
                return heard.status.get("fusion", {}).get("executor") == who

            wait_until(lambda: fuses("cluster"), 90, "the cluster is in use")
            heard.hears("fused/depth")
            assert heard.status["degraded"] == []
            for process in cluster.processes:
                process.kill()
                process.wait()
            wait_until(lambda: fuses("local"), 60, "the service fuses by itself")
            heard.hears("fused/depth")
            wait_until(lambda: bool(heard.status["degraded"]), 60, "it is said")
            (fault,) = heard.status["degraded"]
            assert "bursts are fused on this machine" in fault["what"]
            assert cluster.address in fault["what"]
            cluster.start_scheduler()
            cluster.start_worker()
            wait_until(lambda: fuses("cluster") and not heard.status["degraded"], 90, "it is used again")
            before = heard.status["fusion"]["cluster"]["fused"]
            wait_until(lambda: heard.status["fusion"]["cluster"]["fused"] > before, 60, "it fuses")
            assert heard.status["drops"]["bursts"] == 0
            assert heard.status["drops"]["fusions"] == 0
            assert service.stop() < 10
