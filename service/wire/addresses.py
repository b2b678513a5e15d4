"""Where a service is found unless it is told otherwise."""

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Loopback: nothing is reachable from outside until it is configured. 7447 is Zenoh's own port."""

DEFAULT_PREFIX = "lidarboost/rig"
"""What every Zenoh key begins with."""
