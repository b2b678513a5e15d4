"""How soon commands are answered that touch no device and wait for no burst, under full load.

Run by `daemon_rates.py --only commands`: an idle service, for comparison; one that scans and fuses as fast as
it can, recording; and the same with a camera that has stopped answering. Commands come from another process.
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median, quantiles

COMMANDS = 600
"""In turn over the verbs below, a little slower than the service takes them (50 a second)."""

ASKING = """
import json, sys, time, zenoh
config = zenoh.Config.from_json5(
    '{mode: "client", connect: {endpoints: ["' + sys.argv[1] + '"], timeout_ms: -1}}'
)
asked = [("cmd/" + name, json.dumps({"action": "get"})) for name in ("settings", "plan", "fusion", "replay")]
asked += [("cmd/record", json.dumps({"action": "list"})), ("manifest", None)]
taken, end = [], time.monotonic() + 120
with zenoh.open(config) as session:
    while True:
        assert time.monotonic() < end, "no service, or no map of it, within two minutes"
        status = list(session.get("lidarboost/rig/status", timeout=1.0))
        told = json.loads(status[0].ok.payload.to_bytes()) if status and status[0].ok else {}
        if told and (told["state"] == "idle" or told["totals"]["fused"] >= 3):
            break
        time.sleep(0.2)
    print("ready", flush=True)
    assert sys.stdin.readline()
    for number in range(int(sys.argv[2])):
        key, payload = asked[number % len(asked)]
        began = time.perf_counter()
        replies = list(session.get("lidarboost/rig/" + key, payload=payload, timeout=20.0))
        taken.append(time.perf_counter() - began)
        assert len(replies) == 1 and replies[0].ok, (key, replies)
        time.sleep(max(0.0, 0.025 - taken[-1]))
print(json.dumps(taken))
"""

STUCK = """
import sys, time
from pathlib import Path
import drivers.simulated
from drivers.errors import DeviceTimeoutError
class StuckCamera(drivers.simulated.SimulatedCamera):
    def _grab(self, timeout):
        if Path(flag).exists():
            time.sleep(timeout)
            raise DeviceTimeoutError("no frame came")
        return super()._grab(timeout)
flag = sys.argv.pop()
drivers.simulated.SimulatedCamera = StuckCamera
from service.entry import main
main()
"""


def answers(config: Path, endpoint: str, root: Path, *, stuck: bool = False) -> list[float]:
    """Seconds that each command took, while the service of that configuration works."""
    flag = config.with_name("stuck")
    serve = [sys.executable, "-c", STUCK, "run", str(config), "--json", str(flag)]
    ask = [sys.executable, "-c", ASKING, endpoint, str(COMMANDS)]
    service = subprocess.Popen(serve, cwd=root, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        with subprocess.Popen(ask, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as asking:
            assert asking.stdout is not None
            assert asking.stdout.readline() == "ready\n", "no map came"
            if stuck:
                flag.touch()
            said, _ = asking.communicate("begin\n")
    finally:
        service.terminate()
        service.wait(60)
    taken: list[float] = json.loads(said)
    return taken


def told(taken: list[float], situation: str) -> Iterator[str]:
    """A row of the table."""
    milliseconds = [1000 * one for one in taken]
    late = sum(one > 50 for one in milliseconds)
    yield (
        f"commands, {situation}: {len(taken)} answered, median {median(milliseconds):.1f} ms, "
        f"99th percentile {quantiles(milliseconds, n=100)[98]:.1f} ms, "
        f"most {max(milliseconds):.1f} ms (50), {late} later than that"
    )
