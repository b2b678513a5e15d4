"""Names of what every recording carries beside its messages."""

CALIBRATION = "calibration.toml"
CONFIGURATION = "configuration.toml"
THUMBNAIL = "thumbnail.png"
TRUE_CALIBRATION = "true-calibration.toml"
"""Of a simulated camera whose calibration is not the true one."""

TRUTH = "truth.npz"
VERSIONS = "versions.json"

METADATA = "lidarboost"
"""The metadata record: run id, rig, camera serial, software version."""

FRAMES_PER_BURST = "frames_per_burst"
"""Key in the metadata: frames in a whole burst, so that a torn file can say what its last one lacks."""
