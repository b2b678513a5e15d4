"""A rig run from another process with nothing but Zenoh and JSON, from idle to its end."""

import json
from pathlib import Path

import pytest
from rig_process import rig_process

pytestmark = pytest.mark.faults


def test_a_rig_is_run_from_idle_to_its_end(tmp_path: Path) -> None:
    from drivers.recording import open_recording

    with rig_process(tmp_path) as rig:
        assert rig.wait_state("idle")["source"] == "simulation"
        check = rig.ask("cmd/scan", action="check")["check"]
        assert check["poses"] == 5
        assert check["exposure"]["noise"] > 0
        once = json.dumps({"action": "once", "map": True})
        first, *messages = rig.far.query("lidarboost/rig/cmd/scan", payload=once, timeout=60)
        assert first["ok"]["report"]["method"] == "nearest"
        assert {"fused/depth", "fused/report"} <= {message["attachment"] for message in messages}
        assert rig.ask("cmd/fusion", action="set", method="bicubic")["fusion"]["method"] == "bicubic"
        assert rig.ask("cmd/scan", action="once")["report"]["method"] == "bicubic"
        assert rig.ask("cmd/stream", action="start", window=3)["state"] == "streaming"
        assert rig.ask("cmd/stream", action="stop")
        rig.wait_state("idle")
        assert rig.ask("cmd/scan", action="start")["state"] == "scanning"
        assert rig.ask("cmd/scan", action="pause")["paused"]
        assert rig.ask("cmd/settings", action="set", integration_time=0.01)["code"] == "INVALID_STATE"
        assert not rig.ask("cmd/scan", action="resume")["paused"]
        assert rig.ask("cmd/settings", action="set", integration_time=0.01)["state"] == "scanning"
        assert rig.ask("cmd/plan", action="set", pan=500)["code"] == "OUT_OF_RANGE"
        assert rig.ask("cmd/scan", action="cancel")
        rig.wait_state("idle")
        name = Path(rig.ask("cmd/record", action="stop")["recorder"]["file"]).name
        replay = rig.ask("cmd/replay", action="load", file=name)["replay"]
        assert (replay["playing"], replay["bursts"] >= 2) == (False, True)
        assert rig.wait_state("scanning")["source"] == "replay"
        assert rig.ask("cmd/replay", action="step")["report"]["burst"] == 0
        assert rig.ask("cmd/replay", action="seek", burst=1)["replay"]["burst"] == 1
        reply = rig.ask("cmd/replay", action="step")
        assert reply.get("report", reply)["frames"] == 5
        assert rig.ask("cmd/replay", action="stop")["state"] == "idle"
        assert rig.wait_state("idle")["source"] == "simulation"
        rig.end()
    said = rig.log.read_text()
    assert "cmd/fusion {'method': 'bicubic', 'action': 'set'} by somebody" in said
    (path,) = (tmp_path / "disk" / "recordings").glob("*.mcap")
    found = open_recording(path).contents.metadata
    records = [record.metadata for record in found if record.name == "command"]
    told = [(record["command"], json.loads(record["arguments"])["action"]) for record in records]
    assert ("cmd/fusion", "set") in told
    assert {record["who"] for record in records} == {"somebody"}
