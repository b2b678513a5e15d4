"""The status as Prometheus metrics."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, get_args

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from service.messages.status import SinkState, State, Status


class StatusCollector(Collector):
    """Gives the latest status whenever somebody looks; nothing before the first."""

    def __init__(self) -> None:
        self.status: Status | None = None

    def collect(self) -> Iterable[Metric]:
        status = self.status
        return () if status is None else tuple(_families(status))

    def describe(self) -> Iterable[Metric]:
        return ()


def _families(status: Status) -> Iterator[Metric]:
    totals, rates, fusion = status.totals, status.rates, status.fusion
    yield _labelled("lidarboost_build_info", "What runs here.", ("version",), {(status.version,): 1})
    states = {(name,): float(name == status.state) for name in get_args(State)}
    yield _labelled("lidarboost_state", "1 for the state it is in.", ("state",), states)
    yield _gauge("lidarboost_paused", "Whether it stands still between two poses.", status.paused)
    yield _gauge("lidarboost_uptime_seconds", "Since the start.", status.uptime)
    yield _gauge("lidarboost_degraded", "How many things do not work at present.", len(status.degraded))
    yield _counter("lidarboost_frames", "Frames captured.", totals.frames)
    yield _counter("lidarboost_bursts", "Bursts completed.", totals.bursts)
    yield _counter("lidarboost_maps", "Maps fused.", totals.fused)
    yield _counter("lidarboost_maps_unconverged", "Maps whose solve did not converge.", totals.unconverged)
    yield _gauge("lidarboost_frames_per_second", "Over the last ten seconds.", rates.frames)
    yield _gauge("lidarboost_maps_per_second", "Over the last ten seconds.", rates.fused)
    drops = {(cause,): float(count) for cause, count in status.drops.model_dump().items()}
    yield _labelled("lidarboost_dropped", "What was lost, by cause.", ("cause",), drops, counts=True)
    yield _gauge("lidarboost_fusion_waiting", "Bursts, or frames of a stream, that wait.", fusion.backlog)
    yield _counter("lidarboost_fusion_restarts", "Times that its process was started again.", fusion.restarts)
    if (cluster := fusion.cluster) is not None:
        yield _gauge("lidarboost_cluster_workers", "That fuse; 0 = it is not in use.", cluster.workers)
        yield _counter("lidarboost_cluster_maps", "Maps that came from it.", cluster.fused)
        text = "Bursts that it did not fuse, which were fused here."
        yield _counter("lidarboost_cluster_returned", text, cluster.returned)
    if status.latency is not None:
        yield _gauge("lidarboost_latency_seconds", "From the last exposure to its map.", status.latency)
    hands = {(one.who, one.topic): one.latency for one in status.subscribers}
    text = "From the last exposure to the hands of a subscriber and back, median."
    yield _labelled("lidarboost_subscriber_latency_seconds", text, ("who", "topic"), hands)
    yield from _sinks(status.sinks)
    yield from _recorder(status)
    refused = {(code,): float(count) for code, count in status.commands.refused.items()}
    yield _counter("lidarboost_commands", "Commands carried out.", status.commands.accepted)
    yield _labelled("lidarboost_commands_refused", "By code.", ("code",), refused, counts=True)


def _sinks(sinks: Iterable[SinkState]) -> Iterator[Metric]:
    by_name = {(sink.name,): sink for sink in sinks}
    running = {name: float(sink.state == "running") for name, sink in by_name.items()}
    yield _labelled("lidarboost_sink_running", "1 = it works.", ("sink",), running)
    waiting = {name: float(sink.waiting) for name, sink in by_name.items()}
    yield _labelled("lidarboost_sink_waiting", "Events in its queue.", ("sink",), waiting)
    dropped = {name: float(sink.dropped) for name, sink in by_name.items()}
    text = "Events lost to it; of a recorder: messages."
    yield _labelled("lidarboost_sink_dropped", text, ("sink",), dropped, counts=True)
    faults = {name: float(sink.faults) for name, sink in by_name.items()}
    yield _labelled("lidarboost_sink_faults", "Times that it failed.", ("sink",), faults, counts=True)


def _recorder(status: Status) -> Iterator[Metric]:
    recorder = status.recorder
    yield _gauge("lidarboost_recording", "1 = it records.", recorder is not None and recorder.recording)
    if recorder is None:
        return
    yield _gauge("lidarboost_recorder_file_bytes", "In the file at work.", recorder.size)
    yield _counter("lidarboost_recorder_messages", "Messages written.", recorder.messages)
    yield _counter("lidarboost_recorder_lost", "Messages that could not be written.", recorder.lost)
    if recorder.free is not None:
        yield _gauge("lidarboost_recorder_free_bytes", "On its disk.", recorder.free)


def _gauge(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(name, text, value=float(value))


def _counter(name: str, text: str, value: float) -> Metric:
    return CounterMetricFamily(name, text, value=float(value))


def _labelled(
    name: str,
    text: str,
    labels: tuple[str, ...],
    values: Mapping[Any, float],
    *,
    counts: bool = False,
) -> Metric:
    kind = CounterMetricFamily if counts else GaugeMetricFamily
    family = kind(name, text, labels=labels)
    for key, value in values.items():  # a key is a value of each label
        family.add_metric(key, value)
    return family
