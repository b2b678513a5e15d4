"""How the service is doing: diagnostic_msgs/DiagnosticArray (REP 107)."""

from service.messages.ros.topics import DIAGNOSTIC_ARRAY, DIAGNOSTICS
from service.messages.ros.types import RosMessage, RosTypes
from service.messages.status import Status

OK, WARN, ERROR = 0, 1, 2


def diagnostics(types: RosTypes, status: Status, name: str) -> RosMessage:
    """One status, named after the node."""
    level, told = _judged(status)
    values = {
        "state": status.state,
        "reason": status.reason,
        "source": status.source,
        "frames per second": f"{status.rates.frames:.2f}",
        "maps per second": f"{status.rates.fused:.2f}",
        "frames": status.totals.frames,
        "maps": status.totals.fused,
        "latency, s": None if status.latency is None else f"{status.latency:.3f}",
        "frames dropped by the camera": status.drops.camera,
        "faults": status.drops.faults,
        "fusions failed": status.drops.fusions,
    } | {f"degraded: {one.what}": one.remedy for one in status.degraded}
    found = types.make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=level,
        name=f"{name}: rig",
        message=told,
        hardware_id=" ".join(filter(None, (status.model, status.serial))),
        values=[
            types.make("diagnostic_msgs/msg/KeyValue", key=key, value=str(value))
            for key, value in values.items()
            if value is not None
        ],
    )
    message = types.make(DIAGNOSTIC_ARRAY, header=types.header(status.timestamp, ""), status=[found])
    return RosMessage(DIAGNOSTICS, types.cdr(DIAGNOSTIC_ARRAY, message))


def _judged(status: Status) -> tuple[int, str]:
    if status.state == "recovering":
        return ERROR, status.reason or "recovering"
    if status.degraded:
        return WARN, "; ".join(one.what for one in status.degraded)
    if status.error is not None:
        return WARN, status.error.what
    return OK, f"{status.state}: {status.reason}" if status.reason else str(status.state)
