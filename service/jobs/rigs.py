"""Which rigs are alive, and whether they disturb each other."""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import zenoh

from service.errors import RemoteError
from service.messages.decoding import decode, read
from service.messages.status import Status
from service.wire.session import open_session

_BUSY = ("scanning", "streaming")

_SAME = 0.05e6
"""Hz; the frequencies that these cameras offer lie at least half a megahertz apart."""

_RETRY = 0.1


@dataclass(frozen=True, slots=True)
class FoundRig:
    """One that answered.

    Attributes:
        endpoint: where it was asked.
        prefix: what its keys begin with.
        state, reason: what it is doing, and why.
        source, model, serial: its camera.
        modulation_frequency: of its light, Hz; 0 = not known.
        degraded: what does not work.
    """

    endpoint: str
    prefix: str
    state: str
    reason: str
    source: str | None
    model: str | None
    serial: str | None
    modulation_frequency: float
    degraded: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """Its fields."""
        return asdict(self)


def rigs_at(endpoints: Sequence[str], timeout: float) -> tuple[list[FoundRig], list[str]]:
    """The rigs that answer at some endpoints, or through routers there, and the endpoints that are silent.

    Nothing is searched for elsewhere.

    Args:
        endpoints: where to ask.
        timeout: seconds for each.

    Raises:
        SessionError: an endpoint is none.
    """
    found: dict[tuple[str, str], FoundRig] = {}
    silent = []
    for endpoint in endpoints:
        there = _answers(endpoint, timeout)
        if not there:
            silent.append(endpoint)
        for who, rig in there:
            found.setdefault((who, rig.prefix), rig)
    return list(found.values()), silent


def warnings_about(rigs: Sequence[FoundRig]) -> list[str]:
    """What is wrong between them: names twice, and light of one frequency at the same time."""
    said = []
    for one, other in combinations(rigs, 2):
        where = f"{_name(one)} and {_name(other)}"
        if one.prefix == other.prefix:
            said.append(f"{where} have one name: give one of them another zenoh.prefix")
        disturbing = all(rig.state in _BUSY and rig.source == "device" for rig in (one, other))
        apart = abs(one.modulation_frequency - other.modulation_frequency)
        if disturbing and one.modulation_frequency and apart < _SAME:
            said.append(
                f"{where} run at the same time with the same modulation frequency of "
                f"{one.modulation_frequency / 1e6:g} MHz: distances are wrong where one lights what the "
                "other sees; set another settings.modulation_frequency"
            )
    return said


def _name(rig: FoundRig) -> str:
    return f"{rig.prefix} at {rig.endpoint}"


def _answers(endpoint: str, timeout: float) -> list[tuple[str, FoundRig]]:
    deadline = time.monotonic() + timeout
    with open_session(listen=(), connect=(endpoint,)) as session:
        while (left := deadline - time.monotonic()) > 0:
            replies = list(
                session.get(
                    "**/status",
                    target=zenoh.QueryTarget.ALL,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    timeout=left,
                )
            )
            found = [rig for reply in replies if (rig := _rig(reply, endpoint)) is not None]
            if found:
                return found
            time.sleep(min(_RETRY, left))
    return []


def _rig(reply: zenoh.Reply, endpoint: str) -> tuple[str, FoundRig] | None:
    if reply.ok is None:
        return None
    key, who = str(reply.ok.key_expr), str(reply.replier_id)
    try:
        told = read(Status, decode("status", str(reply.ok.encoding), reply.ok.payload.to_bytes()))
    except RemoteError:  # something else of that name
        return None
    return who, FoundRig(
        endpoint=endpoint,
        prefix=key.removesuffix("/status"),
        state=str(told.state),
        reason=told.reason,
        source=told.source,
        model=told.model,
        serial=told.serial,
        modulation_frequency=told.in_force.modulation_frequency,
        degraded=tuple(fault.what for fault in told.degraded),
    )
