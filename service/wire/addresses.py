"""Where a service is found unless it is told otherwise, and what strangers ask it first."""

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Loopback: nothing is reachable from outside until it is configured. 7447 is Zenoh's own port."""

DEFAULT_PREFIX = "lidarboost/rig"
"""What every Zenoh key begins with."""

MANIFEST, SCHEMA = "manifest", "schema"
"""Keys, behind the prefix, that tell who a service is and how its payloads are read."""
