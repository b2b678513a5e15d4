"""Somebody who publishes images over Zenoh: a peer on loopback."""

import socket
import threading
from contextlib import contextmanager

import zenoh
import zenoh.ext
from made_frames import make_frame

from drivers import sr3000_calibration
from drivers.calibration import Mount
from drivers.messages import calibration_message, frame_messages

PERIOD = 0.01


class Source:
    """Publishes on keys of one session; what is latched is kept for late subscribers."""

    def __init__(self, session, endpoint):
        self.session, self.endpoint = session, endpoint
        self._publishers = {}
        self._stop, self._threads = threading.Event(), []

    def publisher(self, key, latched=False):
        if key not in self._publishers:
            blocks = {"congestion_control": zenoh.CongestionControl.BLOCK}
            more = {"cache": zenoh.ext.CacheConfig(max_samples=1), "publisher_detection": True}
            self._publishers[key] = (
                zenoh.ext.declare_advanced_publisher(self.session, key, **more, **blocks)
                if latched
                else self.session.declare_publisher(key, **blocks)
            )
        return self._publishers[key]

    def put(self, key, payload, encoding="", latched=False):
        self.publisher(key, latched).put(payload, encoding=encoding)

    def put_message(self, prefix, message, latched=False):
        kind = "protobuf" if message.message_encoding == "protobuf" else "json"
        encoding = f"application/{kind};{message.schema.name}"
        self.put(f"{prefix}/{message.topic}", message.payload, encoding, latched)

    def is_heard(self, *keys):
        return all(self.publisher(key).matching_status.matching for key in keys)

    def repeat(self, publish, *keys, period=PERIOD):
        """Call `publish` with 0, 1, 2, … while somebody listens on all keys."""

        self._stop.clear()

        def run():
            number = 0
            while not self._stop.wait(period):
                if self.is_heard(*keys):
                    publish(number)
                    number += 1

        self._threads.append(threading.Thread(target=run, name="source"))
        self._threads[-1].start()

    def close(self):
        """Publish no more, until `repeat`."""
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self._threads.clear()


@contextmanager
def zenoh_source():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    config = zenoh.Config()
    for key, value in {
        "scouting/multicast/enabled": "false",
        "listen/endpoints": f'["{endpoint}"]',
        "timestamping/enabled": "true",
    }.items():
        config.insert_json5(key, value)
    session = zenoh.open(config)
    source = Source(session, endpoint)
    try:
        yield source
    finally:
        source.close()
        session.close()


def rig_frames(source, prefix="far/rig"):
    """Another rig that scans on and on."""
    source.put_message(prefix, calibration_message(sr3000_calibration(), 1), latched=True)

    def publish(number):
        burst, pose = divmod(number, 5)
        for message in frame_messages(make_frame(number, burst=burst, pose=pose), Mount()):
            source.put_message(prefix, message)

    source.repeat(publish, *(f"{prefix}/camera/{name}" for name in ("distance", "amplitude", "frame")))
