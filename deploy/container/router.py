"""A Zenoh router, for where no zenohd is at hand: python router.py FILE.json5"""

import signal
import sys
import threading

import zenoh

over = threading.Event()
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda *_: over.set())
with zenoh.open(zenoh.Config.from_file(sys.argv[1])) as session:
    print("routing as", session.info.zid(), flush=True)
    over.wait()
