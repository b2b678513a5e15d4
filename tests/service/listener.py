"""A subscriber in a process of its own, as a stranger would write it: Zenoh and the public Foxglove schemas.

Usage: listener.py ENDPOINT PREFIX COUNT [--advanced] [--until TOPIC] [--get TOPIC]
Prints one JSON line per message received (or answer got), and ends after COUNT of them, or after TOPIC.
"""

import argparse
import hashlib
import json
import queue

import numpy as np
import zenoh
import zenoh.ext
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

KINDS = {
    f"application/protobuf;{kind.DESCRIPTOR.full_name}": kind
    for kind in (CameraCalibration, FrameTransform, Log, PointCloud, RawImage)
}


def describe(sample: zenoh.Sample) -> dict[str, object]:
    payload = sample.payload.to_bytes()
    encoding = str(sample.encoding)
    told: dict[str, object] = {
        "key": str(sample.key_expr),
        "encoding": encoding,
        "sha256": hashlib.sha256(payload).hexdigest(),
    }
    if encoding.startswith("application/json"):
        return told | {"json": json.loads(payload)}
    message = KINDS[encoding]()
    message.ParseFromString(payload)
    told |= {"timestamp": message.timestamp.ToNanoseconds(), "frame_id": getattr(message, "frame_id", None)}
    if isinstance(message, RawImage) and message.encoding == "32FC1":
        image = np.frombuffer(message.data, "<f4").reshape(message.height, message.width)
        told |= {
            "shape": image.shape,
            "mean": float(np.nanmean(image)),
            "known": int(np.isfinite(image).sum()),
        }
    if isinstance(message, CameraCalibration):
        told |= {"K": list(message.K), "shape": [message.height, message.width]}
    if isinstance(message, PointCloud):
        told |= {
            "points": len(message.data) // message.point_stride,
            "fields": [f.name for f in message.fields],
        }
    return told


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("endpoint")
    parser.add_argument("prefix")
    parser.add_argument("count", type=int)
    parser.add_argument("--advanced", action="store_true")
    parser.add_argument("--get")
    parser.add_argument("--until")
    options = parser.parse_args()
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/endpoints", json.dumps([options.endpoint]))
    config.insert_json5(
        "connect/retry", "{period_init_ms: 50, period_max_ms: 100, period_increase_factor: 1}"
    )
    received: queue.Queue[zenoh.Sample] = queue.Queue()
    with zenoh.open(config) as session:
        if options.get:
            while not (answers := [a.ok for a in session.get(f"{options.prefix}/{options.get}") if a.ok]):
                pass
            for answer in answers:
                print(json.dumps(describe(answer)), flush=True)
            return
        key = f"{options.prefix}/**"
        if options.advanced:
            history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
            subscriber = zenoh.ext.declare_advanced_subscriber(session, key, received.put, history=history)
        else:
            subscriber = session.declare_subscriber(key, received.put)
        with subscriber, session.liveliness().declare_token("test/listening"):
            for _ in range(options.count):
                told = describe(received.get(timeout=60))
                print(json.dumps(told), flush=True)
                if told["key"] == f"{options.prefix}/{options.until}":
                    break


main()
