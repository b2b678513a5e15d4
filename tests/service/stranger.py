"""Commands a service from a process of its own, as a stranger would write it: Zenoh and JSON alone.

Usage: stranger.py ENDPOINT
Reads one JSON line per query, {"key", "payload" (text) or "size" (bytes of zeros) or neither, "timeout",
"attachment"}, and prints one per query: a list of replies, {"ok": JSON or bytes' length, "encoding",
"attachment"} or {"error": JSON}, and "seconds".
"""

import json
import sys
import time

import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"peer"')
config.insert_json5("listen/endpoints", "[]")
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))


def told(reply: zenoh.Reply) -> dict[str, object]:
    if reply.err is not None:
        return {"error": json.loads(reply.err.payload.to_bytes())}
    sample = reply.ok
    payload = sample.payload.to_bytes()
    is_json = str(sample.encoding).startswith("application/json")
    return {
        "ok": json.loads(payload) if is_json else len(payload),
        "key": str(sample.key_expr),
        "encoding": str(sample.encoding),
        "attachment": None if sample.attachment is None else sample.attachment.to_string(),
    }


with zenoh.open(config) as session:
    while not list(session.info.routers_zid()) and not list(session.info.peers_zid()):
        time.sleep(0.02)
    print("connected", flush=True)
    for line in sys.stdin:
        asked = json.loads(line)
        payload = asked.get("payload")
        if "size" in asked:
            payload = bytes(asked["size"])
        began = time.monotonic()
        replies = session.get(
            asked["key"],
            payload=payload,
            timeout=asked.get("timeout", 20),
            attachment=asked.get("attachment"),
            consolidation=zenoh.ConsolidationMode.NONE,
        )
        if asked.get("vanish"):
            break
        answers = [told(reply) for reply in replies]
        print(json.dumps({"replies": answers, "seconds": time.monotonic() - began}), flush=True)
