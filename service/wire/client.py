"""Talking to a running service: its latest values, and its messages as they come."""

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Any, Self

import numpy as np
import zenoh
import zenoh.ext

from drivers.documents import parse_json
from drivers.messages import CAMERA_CALIBRATION
from service.errors import RemoteError, SessionError
from service.messages.decoding import Received, decode
from service.messages.receipt import RECEIPT, Receipt
from service.messages.topics import ALIVE, FUSED_CALIBRATION, FUSED_DEPTH_MM, TOPICS, Congestion, Topic
from service.wire.addresses import DEFAULT_ENDPOINT, DEFAULT_PREFIX, MANIFEST, SCHEMA
from service.wire.asking import Answer, Asking
from service.wire.recordings import Record, Replay
from service.wire.session import open_session
from service.wire.subscription import CALIBRATION_WAIT, LatestCalibration, Subscription
from service.wire.verbs import Scan, Section, Stage, Stream

_IMAGES = 2
"""Images that wait for a slow reader: the one it takes next, and the newest."""
_MESSAGES = 256
"""Small messages that wait: minutes of status, or a storm in the log."""

_RETRY = 0.05


class Client:
    """A connection to a running service. It need not run yet: it is waited for.

    ```python
    with Client() as rig:
        depth = rig.latest("fused/depth")  # depth.value (H, W) metres, depth.intrinsics (3, 3)
        for report in rig.subscribe("fused/report"):
            print(report.value["deviation"])
        rig.fusion.set(method="phasor")
        answer = rig.scan.once(map=True)  # answer["report"], answer.messages["fused/depth"]
    ```

    Args:
        endpoint: where the service, or a router, listens.
        prefix: of the service's keys.
        config: Zenoh's own JSON5 file, for certificates and the like; endpoints that it names go before
            `endpoint`.
        receipts: tell the service when a map of a subscription is in hand: its status then shows how long
            that took.

    Attributes:
        scan, stream, stage, record, replay, settings, plan, fusion: its commands; they raise a
            `CommandError`.

    Raises:
        SessionError: the endpoint or the prefix is not one, or the file cannot be used.
    """

    def __init__(
        self,
        endpoint: str = DEFAULT_ENDPOINT,
        prefix: str = DEFAULT_PREFIX,
        *,
        config: str | Path | None = None,
        receipts: bool = False,
    ) -> None:
        self._endpoint, self._prefix, self._receipts = endpoint, prefix, receipts
        try:
            zenoh.KeyExpr(prefix)
        except zenoh.ZError as error:
            raise SessionError(
                f"the prefix {prefix!r} is no key; expected one like {DEFAULT_PREFIX}"
            ) from error
        self._resources = ExitStack()
        file = None if config is None else Path(config)
        self._session = self._resources.enter_context(open_session((), (endpoint,), file))
        self._subscriptions: set[Subscription] = set()
        self._resources.callback(self._close_subscriptions)
        self._calibrations: dict[str, LatestCalibration] = {}
        self._watching = Lock()
        self._asking = Asking(self._session, prefix, endpoint)
        self.scan, self.stream, self.stage = Scan(self.command), Stream(self.command), Stage(self.command)
        self.record, self.replay = Record(self.command), Replay(self.command)
        self.settings = Section(self.command, "cmd/settings")
        self.plan, self.fusion = Section(self.command, "cmd/plan"), Section(self.command, "cmd/fusion")

    def command(self, name: str, /, action: str, timeout: float = 60.0, **arguments: Any) -> Answer:
        """Have any command carried out, and wait until it is.

        Args:
            name: such as `cmd/scan`.
            action: its verb.
            timeout: seconds.
            arguments: of the verb.

        Raises:
            CommandError: it was refused, and nothing changed; of a class of its own for each code.
            RemoteError: no service, or no answer in time.
        """
        return self.ask(name, {"action": action, **arguments}, timeout)

    def ask(self, name: str, request: Mapping[str, Any], timeout: float = 60.0) -> Answer:
        """As `command`, of a request as it is sent: its fields may have any name, also `timeout`."""
        return self._asking.ask(name, timeout, dict(request))

    def close(self) -> None:
        """Close the connection and all subscriptions."""
        self._resources.close()

    def latest(self, topic: str, timeout: float = 5.0) -> Received:
        """The latest value of a topic; the next one where the service keeps none (raw frames).

        Raises:
            RemoteError: unknown topic, no service, or no value within `timeout` seconds.
        """
        row = _published(topic)
        if not row.latest:
            with self.subscribe(topic) as messages:
                return messages.receive(timeout)
        sample = self._ask(topic, timeout)
        if sample is None:
            raise RemoteError(self._explain(topic, timeout))
        return self._decode(sample)

    def subscribe(self, topic: str, handler: Callable[[Received], None] | None = None) -> Subscription:
        """Messages as they come, the latest one first where the service keeps it.

        Of images a slow reader gets the newest; those in between are lost to it, and to it alone.

        Args:
            topic: a topic's name.
            handler: called with each message from a thread of its own; None = iterate or `receive`.

        Raises:
            RemoteError: unknown topic.
        """
        row = _published(topic)
        keep = _IMAGES if row.congestion is Congestion.DROP else _MESSAGES
        read = self._confirmed if self._receipts and topic.startswith("fused/") else self._decode
        subscription = Subscription(
            topic, keep, read, lambda arrived: self._declare(topic, arrived), self._subscriptions.discard
        )
        self._subscriptions.add(subscription)
        if handler is not None:
            subscription.call(handler)
        return subscription

    def watch_presence(self, handler: Callable[[bool], None]) -> None:
        """Have `handler` told, from a thread of Zenoh's, when a service of this name comes and goes."""
        subscriber = self._session.liveliness().declare_subscriber(
            f"{self._prefix}/{ALIVE}",
            lambda sample: handler(sample.kind == zenoh.SampleKind.PUT),
            history=True,
        )
        self._resources.callback(subscriber.undeclare)

    def manifests(self, timeout: float = 2.0) -> list[dict[str, Any]]:
        """What each service of this name says that it is; none where none runs."""
        replies = self._session.get(
            f"{self._prefix}/{MANIFEST}",
            timeout=timeout,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
        )
        return [_document(reply.ok) for reply in replies if reply.ok is not None]

    def command_schemas(self, timeout: float = 2.0) -> dict[str, dict[str, Any]]:
        """JSON schemas of `request` and `reply` of every command, by its name."""
        kind = f"{self._prefix}/{SCHEMA}/"
        replies = self._session.get(f"{kind}cmd/**", timeout=timeout)
        found = [reply.ok for reply in replies if reply.ok is not None]
        named = {str(sample.key_expr).removeprefix(kind): _document(sample) for sample in found}
        return dict(sorted(named.items()))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _declare(self, topic: str, arrived: Callable[[zenoh.Sample], None]) -> Any:
        return zenoh.ext.declare_advanced_subscriber(
            self._session,
            f"{self._prefix}/{topic}",
            arrived,
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
            recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
        )

    def _ask(self, topic: str, timeout: float) -> zenoh.Sample | None:
        deadline = time.monotonic() + timeout
        while (left := deadline - time.monotonic()) > 0:
            for reply in self._session.get(f"{self._prefix}/{topic}", timeout=left):
                if reply.ok is not None:
                    return reply.ok
            time.sleep(_RETRY)
        return None

    def _decode(self, sample: zenoh.Sample) -> Received:
        topic = str(sample.key_expr).removeprefix(f"{self._prefix}/")
        received = decode(topic, str(sample.encoding), sample.payload.to_bytes())
        if not isinstance(received.value, np.ndarray) or received.value.ndim != 2:
            return received
        source = CAMERA_CALIBRATION if topic.startswith("camera/") else FUSED_CALIBRATION
        image = self._calibration(source).given_to(received)
        # What is made for viewers has its distortion taken out.
        flat = topic == FUSED_DEPTH_MM and image.distortion is not None
        return replace(image, distortion=np.zeros_like(image.distortion)) if flat else image

    def _confirmed(self, sample: zenoh.Sample) -> Received:
        received = self._decode(sample)
        if received.timestamp is not None:
            receipt = Receipt(who=self._asking.who, topic=received.topic, timestamp=received.timestamp)
            key = f"{self._prefix}/{RECEIPT}/{self._session.info.zid()}"
            self._session.put(key, receipt.model_dump_json(), congestion_control=zenoh.CongestionControl.DROP)
        return received

    def _calibration(self, topic: str) -> "LatestCalibration":
        """The latest calibration of a topic, followed from the first image on."""
        with self._watching:
            if topic not in self._calibrations:
                latest = LatestCalibration()
                subscriber = self._declare(topic, latest.arrived)
                self._resources.callback(subscriber.undeclare)
                told = self._ask(topic, CALIBRATION_WAIT)
                if told is not None:
                    latest.arrived(told)
                self._calibrations[topic] = latest
            return self._calibrations[topic]

    def _close_subscriptions(self) -> None:
        for subscription in list(self._subscriptions):
            subscription.close()

    def _explain(self, topic: str, timeout: float) -> str:
        if self._session.info.links():
            return (
                f"{topic}: the service at {self._endpoint} had no value within {timeout:g} s; has it fused "
                f"anything yet, and is its prefix {self._prefix!r}?"
            )
        return (
            f"no service answered at {self._endpoint} within {timeout:g} s; start one with `lidarboost run`, "
            f"or name the endpoint it listens on"
        )


def _document(sample: zenoh.Sample) -> dict[str, Any]:
    try:
        found = parse_json(sample.payload.to_bytes())
    except ValueError as error:
        raise RemoteError(f"{sample.key_expr}: {error}; the service may be another one") from error
    if not isinstance(found, dict):
        raise RemoteError(f"{sample.key_expr}: a {type(found).__name__}, expected an object")
    return found


def _published(topic: str) -> Topic:
    row = TOPICS.get(topic)
    if row is None or row.congestion is Congestion.NONE:
        known = ", ".join(name for name, row in TOPICS.items() if row.congestion is not Congestion.NONE)
        raise RemoteError(f"no topic is called {topic!r}; there are: {known}")
    return row
