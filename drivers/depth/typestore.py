"""ROS messages from their bytes, by the library `rosbags` (extra `import` or `ros2`)."""

from functools import cache
from typing import Any, Literal

from drivers.errors import NotAvailableError, RecordingError

_MISSING = (
    "ROS messages are read by the library rosbags, which is not installed: pip install 'lidarboost[import]'"
)


def ros_message(kind: str, form: Literal["cdr", "ros1"], payload: bytes) -> Any:
    """A message of a common type, such as `sensor_msgs/msg/Image`.

    Raises:
        RecordingError: the bytes are not of it.
        NotAvailableError: the library is not installed.
    """
    store = typestore("ros1_noetic" if form == "ros1" else "ros2_jazzy")
    read = store.deserialize_ros1 if form == "ros1" else store.deserialize_cdr
    try:
        return read(payload, kind)
    except Exception as error:  # garbage fails in its code for each type in every way
        raise RecordingError(f"not a {kind} ({type(error).__name__}: {error})") from error


@cache
def typestore(name: str) -> Any:
    """Message types of a distribution, such as `ros2_jazzy`; raises `NotAvailableError`."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError as error:
        raise NotAvailableError(_MISSING) from error
    store = get_typestore(Stores(name))
    if name == "ros1_noetic":  # whose own store has no transforms
        for kind in ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"):
            store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", kind))
    return store
