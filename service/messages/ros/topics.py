"""Everything that ROS 2 nodes receive: the one table that the sink, the documentation and the tests read."""

from dataclasses import dataclass

DEPTH_IMAGE, DEPTH_INFO = "camera/depth/image_raw", "camera/depth/camera_info"
AMPLITUDE_IMAGE, AMPLITUDE_INFO = "camera/amplitude/image_raw", "camera/amplitude/camera_info"
FUSED_DEPTH_IMAGE, FUSED_DEPTH_INFO = "fused/depth/image_rect", "fused/depth/camera_info"
FUSED_DEVIATION_IMAGE, FUSED_DEVIATION_INFO = "fused/deviation/image_rect", "fused/deviation/camera_info"
FUSED_AMPLITUDE_IMAGE, FUSED_AMPLITUDE_INFO = "fused/amplitude/image_rect", "fused/amplitude/camera_info"
FUSED_CLOUD = "fused/points"
TF, TF_STATIC, DIAGNOSTICS = "/tf", "/tf_static", "/diagnostics"

IMAGE, CAMERA_INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
POINT_CLOUD, TRANSFORMS = "sensor_msgs/msg/PointCloud2", "tf2_msgs/msg/TFMessage"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"


@dataclass(frozen=True, slots=True)
class RosTopic:
    """One row of the table.

    Attributes:
        name: under the namespace, or with a leading slash.
        kind: its type.
        latched: transient local: late subscribers receive the last one.
        description: what it is.
    """

    name: str
    kind: str
    latched: bool
    description: str

    def full(self, namespace: str) -> str:
        """Its absolute name."""
        return self.name if self.name.startswith("/") else f"{namespace.rstrip('/')}/{self.name}"


_ROWS = (
    RosTopic(DEPTH_IMAGE, IMAGE, False, "each frame, 32FC1, Z in metres, NaN unknown, as the lens shows it"),
    RosTopic(DEPTH_INFO, CAMERA_INFO, True, "its optics, with distortion"),
    RosTopic(AMPLITUDE_IMAGE, IMAGE, False, "each frame, mono16, where the camera gives one"),
    RosTopic(AMPLITUDE_INFO, CAMERA_INFO, True, "its optics, with distortion"),
    RosTopic(FUSED_DEPTH_IMAGE, IMAGE, True, "each map, 32FC1, Z in metres, NaN unknown, rectified"),
    RosTopic(FUSED_DEPTH_INFO, CAMERA_INFO, True, "its optics; no distortion is left"),
    RosTopic(FUSED_DEVIATION_IMAGE, IMAGE, True, "each map, 32FC1, one standard deviation of Z, metres"),
    RosTopic(FUSED_DEVIATION_INFO, CAMERA_INFO, True, "its optics"),
    RosTopic(FUSED_AMPLITUDE_IMAGE, IMAGE, True, "each map, 32FC1, where the method gives one"),
    RosTopic(FUSED_AMPLITUDE_INFO, CAMERA_INFO, True, "its optics"),
    RosTopic(
        FUSED_CLOUD, POINT_CLOUD, False, "each map while somebody listens: x, y, z, intensity, deviation"
    ),
    RosTopic(TF, TRANSFORMS, False, "`rig` → `camera_link` with each frame, `rig` → `fused` with each map"),
    RosTopic(TF_STATIC, TRANSFORMS, True, "`camera_link` → `camera_optical_frame`"),
    RosTopic(DIAGNOSTICS, DIAGNOSTIC_ARRAY, False, "once a second: state, rates, losses, what is degraded"),
)

ROS_TOPICS: dict[str, RosTopic] = {row.name: row for row in _ROWS}
"""Every topic by name."""
