"""What the live page costs, and how late it is.

`python tests/benchmarks/page.py [--seconds 20] [--pages 10] [--method nearest]`

A simulated camera at 5 ms gives bursts of 15 frames, each fused, with the page beside the service:

- without pages, then with so many of them (WebSockets in a process of their own; each shows distance,
  depth and deviation and acknowledges every image): frames and maps per second, frames lost (0);
- how much later a map is at a page than at a subscriber of the service (0.3 s at most), and from opening the
  socket to the first map (1 s);
- what the page weighs as transferred, every file of it (1.5 MB).

Run it on an idle machine; targets are in brackets.
"""

import argparse
import asyncio
import json
import re
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any
from urllib.request import Request, urlopen

from daemon_rates import CAMERA, LIDARBOOST, ROOT, rig
from websockets.asyncio.client import connect

from lidarboost import Client

IMAGES = ("camera/distance", "fused/depth", "fused/deviation")


async def show(url: str, seconds: float) -> dict[str, Any]:
    """One page: when each map came, by its time, and how long the first took."""
    began, came = time.time(), {}
    async with connect(url.replace("http", "ws") + "ws", max_size=None) as socket:
        await socket.send(json.dumps({"type": "show", "images": IMAGES}))
        while (left := began + seconds - time.time()) > 0:
            try:
                message = await asyncio.wait_for(socket.recv(), left)
            except TimeoutError:
                break
            if isinstance(message, bytes):
                length = int.from_bytes(message[:4], "little")
                header = json.loads(message[4 : 4 + length])
                if header["topic"] == "fused/depth":
                    came[f"{header['time']:.4f}"] = time.time()
                await socket.send(json.dumps({"type": "ack", "topic": header["topic"]}))
    return {"first": min(came.values(), default=began + seconds) - began, "came": came}


async def show_all(url: str, pages: int, seconds: float) -> list[dict[str, Any]]:
    return await asyncio.gather(*(show(url, seconds) for _ in range(pages)))


class Observer:
    """A subscriber of the service: when each map came, and what the status tells."""

    def __init__(self, endpoint: str) -> None:
        self.came: dict[str, float] = {}
        self.status: dict[str, Any] = {}
        self.client = Client(endpoint)
        self.client.subscribe("fused/depth", self._mapped)
        self.client.subscribe("status", lambda received: self.status.update(received.value))

    def _mapped(self, received: Any) -> None:
        self.came[f"{received.timestamp / 1e9:.4f}"] = time.time()

    def counts(self) -> dict[str, int]:
        return {
            "frames": self.status["totals"]["frames"],
            "maps": self.status["totals"]["fused"],
            "lost": sum(self.status["drops"][cause] for cause in ("camera", "published", "recorded")),
        }

    def over(self, seconds: float) -> dict[str, float]:
        """Frames and maps per second and frames lost meanwhile."""
        before, began = self.counts(), time.time()
        time.sleep(seconds)
        after, passed = self.counts(), time.time() - began
        return {
            "frames/s": (after["frames"] - before["frames"]) / passed,
            "maps/s": (after["maps"] - before["maps"]) / passed,
            "lost": after["lost"] - before["lost"],
        }


@contextmanager
def service(folder: Path, method: str):  # type: ignore[no-untyped-def]
    """A running one: its endpoint and where its page is."""
    lines = [*CAMERA, "integration_time = 0.005", "[stage]", 'backend = "simulated"', "settle = 0.0"]
    lines += ["[fusion]", f'method = "{method}"', "[web]", "enabled = true", "port = 0"]
    with rig(folder, *lines) as (endpoint, config):
        command = [*LIDARBOOST, "run", str(config)]
        pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        with subprocess.Popen(command, cwd=ROOT, **pipes) as process:
            assert process.stdout is not None
            try:
                url = next(
                    found[1]
                    for line in process.stdout
                    if (found := re.search(r"live page: (\S+)", line)) is not None
                )
                threading.Thread(target=process.stdout.read, daemon=True).start()
                yield endpoint, url
            finally:
                process.terminate()


def weight(url: str) -> int:
    """Bytes of every file of the page as they are transferred."""
    from service.web.assets import assets

    total = 0
    for path in assets():
        asked = Request(url + path, headers={"Accept-Encoding": "gzip"})
        with urlopen(asked, timeout=10) as answer:
            total += len(answer.read())
    return total


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--pages", type=int, default=10)
    parser.add_argument("--method", default="nearest")
    parser.add_argument("--shown", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.shown:
        print(json.dumps(asyncio.run(show_all(given.shown, given.pages, given.seconds))))
        return
    with tempfile.TemporaryDirectory() as place, service(Path(place), given.method) as (endpoint, url):
        print(f"weight: {weight(url) / 1e6:.2f} MB as transferred, all files (1.5)")
        observer = Observer(endpoint)
        while observer.status.get("totals", {}).get("fused", 0) < 3:
            time.sleep(0.1)
        print("no page:", _told(observer.over(given.seconds)))
        for pages in (1, given.pages):
            words = [sys.executable, __file__, "--shown", url, "--pages", str(pages)]
            words += ["--seconds", str(given.seconds + 2)]
            with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as browsers:
                time.sleep(1)
                told = _told(observer.over(given.seconds))
                seen = json.loads(browsers.communicate()[0])
            late = [
                at - observer.came[key]
                for page in seen
                for key, at in page["came"].items()
                if key in observer.came
            ]
            first = median(page["first"] for page in seen)
            print(
                f"{pages} pages: {told}; a map is {median(late):.3f} s later than at a subscriber, at most "
                f"{max(late):.3f} (0.3); first map after {first:.2f} s (1)"
            )
        observer.client.close()


def _told(counts: dict[str, float]) -> str:
    return f"{counts['frames/s']:.1f} frames/s, {counts['maps/s']:.2f} maps/s, {counts['lost']} lost (0)"


if __name__ == "__main__":
    main()
