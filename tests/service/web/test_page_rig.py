"""A page and the rig behind it: absent, late, started again, doubled; commanded, recorded, downloaded."""

import json
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from browsing import Browser, ask, opened, served
from commanding import Running, configuration, running
from replaying import playable
from test_commands import hasty_rig

from service.config.sections import Configuration
from service.web import commands
from service.web.server import PageServer
from service.wire.session import open_session

pytestmark = pytest.mark.slow


@pytest.fixture
def settings(tmp_path: Path, endpoint: str) -> Configuration:
    return playable(tmp_path, endpoint)


@pytest.fixture
def service(settings: Configuration) -> Iterator[Running]:
    with running(settings, hasty_rig()) as service:
        yield service


@pytest.fixture
def page(endpoint: str) -> Iterator[PageServer]:
    with served(endpoint) as page:
        yield page


def settled(browser: Browser) -> None:
    """Until the rig is there and idle, and the page knows what it offers."""
    browser.told("rig")
    browser.until(
        lambda m: m["type"] == "message" and m["topic"] == "status" and m["value"]["state"] == "idle"
    )


def test_a_page_waits_for_its_rig_and_follows_it_through_a_restart(
    page: PageServer, endpoint: str, settings: Configuration
) -> None:
    with opened(page) as browser:
        assert browser.told("link")["up"] is False
        refused = browser.command("cmd/scan", "once", timeout=1.0)
        assert refused["code"] == "UNREACHABLE"
        assert endpoint in refused["message"]
        for _ in range(2):
            with running(settings, hasty_rig()):
                assert browser.told("link", up=True)["rigs"] == 1
                rig = browser.told("rig")
                assert rig["manifest"]["model"] == "scripted"
                verbs = rig["schemas"]["cmd/fusion"]["request"]["$defs"].values()
                [change] = [v for v in verbs if v["properties"]["action"]["const"] == "set"]
                assert change["properties"]["upsampling"]["maximum"] == 16
                settled_state = lambda m: m.get("topic") == "status" and m["value"]["state"] == "idle"  # noqa: E731
                browser.until(settled_state)
                assert browser.command("cmd/scan", "once")["value"]["report"]["frames"] == 4
            gone = browser.told("link", up=False)
            assert "no rig answers" in gone["message"]
        with opened(page) as late:  # what was there before is still told
            assert late.told("history")["samples"]
            assert late.told("bursts")["bursts"]


def test_a_rig_that_is_gone_is_told_at_once(page: PageServer, settings: Configuration) -> None:
    with opened(page) as browser:
        with running(settings, hasty_rig()) as service:
            browser.told("link", up=True)
            assert service.daemon is not None
        stopped = time.monotonic()
        browser.told("link", up=False)
        assert time.monotonic() - stopped < 2.0


def test_two_rigs_of_one_name_are_told_apart_from_one(
    page: PageServer, tmp_path: Path, endpoint: str
) -> None:
    def joining(name: str) -> Configuration:
        """A rig that is reached through the router."""
        folder = tmp_path / name
        folder.mkdir()
        told = configuration(folder, endpoint)
        (folder / "zenoh.json5").write_text(
            json.dumps({"mode": "client", "listen": {"endpoints": []}, "connect": {"endpoints": [endpoint]}})
        )
        return told

    router = tmp_path / "router.json5"
    router.write_text(json.dumps({"mode": "router", "listen": {"endpoints": [endpoint]}}))
    with open_session(file=router), opened(page) as browser, running(joining("a"), hasty_rig()):
        settled(browser)
        with running(joining("b"), hasty_rig()) as other:
            mixed = browser.told("link", rigs=2)
            assert "zenoh.prefix" in mixed["message"]
            assert other.daemon is not None
            states = other.daemon.states
            other.wait(lambda: any("mixed up" in fault.what for fault in states.degraded))
        browser.told("link", rigs=1)


def test_a_page_shows_the_rig_that_is_named(settings: Configuration, endpoint: str) -> None:
    zenoh = settings.zenoh.model_copy(update={"prefix": "hall/left"})
    named = settings.model_copy(update={"zenoh": zenoh})
    with ExitStack() as stack:
        stack.enter_context(running(named, hasty_rig()))
        left, right = (
            stack.enter_context(opened(stack.enter_context(served(endpoint, prefix=prefix))))
            for prefix in ("hall/left", "hall/right")
        )
        right.until(lambda m: m["type"] == "link" and "no rig answers" in m["message"])
        assert left.told("rig")["manifest"]["model"] == "scripted"


@pytest.mark.usefixtures("service")
def test_a_scan_brings_progress_report_images_and_a_thumbnail(page: PageServer) -> None:
    with opened(page) as browser:
        settled(browser)
        browser.show("fused/depth", "camera/distance")
        browser.send(
            type="command", id=70, name="cmd/scan", action="once", arguments={"map": True}, timeout=60
        )
        kinds, images, answer, burst, line = set(), {}, None, None, None
        while not (answer and burst and line and "fused/depth" in images):
            message = browser.receive(60)
            if not isinstance(message, dict):
                images[message.header["topic"]] = message
                browser.send(type="ack", topic=message.header["topic"])
            elif message["type"] == "message":
                kinds.add(message["topic"])
            elif message["type"] == "answer":
                answer = message["value"]
            elif message["type"] == "burst":
                burst = message["burst"]
            elif message["type"] == "log":
                line = message["lines"][-1]
        assert {"scan/progress", "fused/report"} <= kinds
        assert answer["report"]["burst"] == burst["burst"]
        assert images["fused/depth"].data.shape == (burst["height"], burst["width"]) == (8, 12)
        assert np.isfinite(images["fused/depth"].values).any()
        picture = ask(page, burst["url"])
        assert picture.headers["content-type"] == "image/png"
        assert picture.content.startswith(b"\x89PNG")
        assert "immutable" in picture.headers["cache-control"]
        assert line["level"] == "INFO"
        assert line["message"]


@pytest.mark.usefixtures("service")
def test_commands_are_passed_on_and_what_the_rig_refuses_is_said_in_its_words(page: PageServer) -> None:
    with opened(page) as browser:
        settled(browser)
        plan = browser.command("cmd/plan", "set", span=2.0)["value"]
        assert plan["plan"]["span"] == 2.0
        assert np.shape(plan["poses"]) == (4, 2)
        assert np.ptp(plan["poses"], axis=0).max() > 0
        refused = browser.command("cmd/plan", "set", span=99)
        assert refused["code"] == "OUT_OF_RANGE"
        assert "less than or equal to 40" in refused["message"]
        assert browser.command("cmd/scan", "leap")["code"] == "INVALID_ARGUMENT"
        answers = []
        for name in ("timeout", "name"):  # called as a call's own are
            browser.send(
                type="command", id=99, name="cmd/fusion", action="set", arguments={name: 50.0}, timeout=60
            )
            answers.append(browser.until(lambda m: isinstance(m, dict) and m.get("id") == 99))
        assert answers[0]["value"]["fusion"]["timeout"] == 50.0
        assert answers[1]["code"] == "INVALID_ARGUMENT"
        check = browser.command("cmd/scan", "check")["value"]["check"]
        assert check["poses"] == 4
        assert check["exposure"]["histogram"]


@pytest.mark.usefixtures("service")
def test_who_wants_something_to_end_never_waits_behind_others(
    page: PageServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(commands, "_MOST", 2)
    with opened(page) as browser:
        settled(browser)
        assert browser.command("cmd/scan", "start")["value"]["state"] == "scanning"
        assert browser.command("cmd/scan", "pause")["value"]["paused"] is True
        for number in (50, 51):
            browser.send(
                type="command", id=number, name="cmd/settings", action="get", arguments={}, timeout=60
            )
        for number in (52, 53):
            browser.send(type="command", id=number, name="cmd/scan", action="once", timeout=60)
        # Both wait for the end of the pause, or are refused for it: a third is not even asked.
        assert browser.command("cmd/scan", "cancel")["value"]["state"] in ("scanning", "idle")


@pytest.mark.usefixtures("service")
def test_recordings_are_listed_kept_played_and_downloaded_whole(
    page: PageServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.web.downloads._PART", 3000)
    with opened(page) as browser:
        settled(browser)
        [listed] = browser.command("cmd/record", "list")["value"]["recordings"]
        assert listed["file"] == "five.mcap"
        content = (tmp_path / "kept" / "five.mcap").read_bytes()
        assert listed["size"] == len(content) > 6000
        got = ask(page, "/recordings/five.mcap")
        assert got.content == content
        assert got.headers["content-disposition"] == "attachment; filename*=UTF-8''five.mcap"
        head = ask(page, "/recordings/five.mcap", method="HEAD")
        assert (head.content, head.headers["content-length"]) == (b"", str(len(content)))
        assert ask(page, "/recordings/none.mcap").status == 404
        for path in ("../zenoh.json5", "%2e%2e/zenoh.json5", "%2fetc%2fpasswd", "..%2f..%2fetc%2fpasswd"):
            assert ask(page, f"/recordings/{path}").status in (403, 404)
        assert browser.command("cmd/replay", "load", file="five.mcap")["value"]["replay"]["frames"] == 20
        assert browser.command("cmd/plan", "get")["value"]["poses"] is None
        assert browser.command("cmd/replay", "step")["value"]["report"]["burst"] == 10
        state = browser.until(
            lambda m: m["type"] == "message" and m["topic"] == "replay/state" and m["value"]["frame"] == 4
        )
        assert state["value"]["duration"] > 0


def test_a_download_whose_rig_ends_is_broken_off(
    page: PageServer, settings: Configuration, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.web.downloads._PART", 500)
    with ExitStack() as stack:
        service = stack.enter_context(running(settings, hasty_rig()))
        service.wait_state("idle")
        answered = ask(page, "/recordings/five.mcap")
        assert answered.status == 200
    monkeypatch.setattr("service.web.downloads._TIMEOUT", 0.5)
    missing = ask(page, "/recordings/five.mcap")
    assert (missing.status, missing.told["code"]) == (503, "UNREACHABLE")
