"""Names of what every recording carries beside its messages."""

CALIBRATION = "calibration.toml"
CONFIGURATION = "configuration.toml"
THUMBNAIL = "thumbnail.png"
TRUTH = "truth.npz"
VERSIONS = "versions.json"

METADATA = "lidarboost"
"""The metadata record: run id, rig, camera serial, software version."""
