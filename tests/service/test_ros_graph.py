"""Nodes that nearly match, and what the doctor says of them; the files of `deploy/` for ROS 2."""

import json
import sys
from pathlib import Path

import pytest
import zenoh
from ros_rig import client, events, free_endpoint, ros_rig
from ruamel.yaml import YAML

from service.config.file import load
from service.config.served import Ros2Section
from service.doctor.ros2 import check_ros2
from service.errors import ConfigurationError
from service.messages.ros.topics import ROS_TOPICS
from service.messages.ros.types import RosTypes
from service.sinks.ros import ros_sink
from service.wire.ros.graph import Endpoint, near_misses
from service.wire.ros.names import Node, dds_type
from service.wire.ros.session import service_endpoints

DEPLOY = Path(__file__).parents[2] / "deploy"
TOPIC = "/lidarboost/fused/depth/image_rect"
IMAGE = "sensor_msgs/msg/Image"


def subscriber(domain=0, kind=IMAGE, type_hash=None, node="viewer", topic=TOPIC):
    told = type_hash or RosTypes().hash(kind)
    name = topic.replace("/", "%")
    return f"@ros2_lv/{domain}/abc/0/1/MS/%/%/{node}/{name}/{dds_type(kind)}/{told}/::,10:,:,:,,"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"domain": 42}, "domain 42, here 0"),
        (
            {"kind": "sensor_msgs/msg/CompressedImage"},
            "type sensor_msgs/msg/CompressedImage, here sensor_msgs/msg/Image",
        ),
        ({"type_hash": "TypeHashNotSupported"}, 'a node of Humble, set [ros2] distribution = "humble"'),
        ({"type_hash": "RIHS01_" + 64 * "0"}, "another definition of the message"),
        ({}, None),
        ({"topic": "/elsewhere"}, None),
    ],
)
def test_the_doctor_lists_who_nearly_matches(tmp_path, changes, said):
    with ros_rig(tmp_path) as (_, sink):
        sink.take(events()[0])
        sections = {"ros2": {"enabled": True}, "zenoh": {"config": str(tmp_path / "service.json5")}}
        (endpoint,) = service_endpoints(tmp_path / "service.json5")
        with client(endpoint) as robot, robot.liveliness().declare_token(subscriber(**changes)):
            found = list(check_ros2(load(None, sections)))
    if said is None:
        assert [check.state for check in found] == ["ok"]
    else:
        (check,) = found
        assert check.state == "warning"
        assert said in check.finding
        assert "/viewer, subscriber of" in check.finding


def test_the_doctor_says_when_nothing_can_be_seen(tmp_path):
    file = tmp_path / "x.json5"
    file.write_text(json.dumps({"listen": {"endpoints": [free_endpoint()]}}))
    sections = {"ros2": {"enabled": True}, "zenoh": {"config": str(file)}}
    (check,) = check_ros2(load(None, sections))
    assert check.state == "warning"
    assert "nothing can be seen" in check.finding
    assert list(check_ros2(load(None, {}))) == []


def test_a_library_that_is_missing_is_named_with_the_line_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "xxhash", None)
    with pytest.raises(ConfigurationError, match=r"pip install 'lidarboost\[ros2\]'"):
        ros_sink(Ros2Section(), None)
    (check,) = check_ros2(load(None, {"ros2": {"enabled": True}}))
    assert (check.state, check.remedy) == ("problem", "pip install 'lidarboost[ros2]'")


def test_tokens_of_other_kinds_are_passed_over():
    for token in ("@ros2_lv/0/a/0/0/NN/%/%/x", "@ros2_lv", subscriber() + "/more", subscriber(domain="x")):
        assert Endpoint.of(token) is None
    node = Node(5, "abc", "/", "n")
    made = node.publisher_token(3, "/a/b", IMAGE, "h", True)
    assert Endpoint.of(made) == Endpoint("publisher", 5, "/n", "/a/b", dds_type(IMAGE), "h")
    assert list(near_misses([Endpoint.of(made)], [Endpoint.of(made)])) == []


def test_where_the_service_is_reached(tmp_path):
    file = tmp_path / "x.json5"
    told = {"listen": {"endpoints": ["tcp/0.0.0.0:7500", "tcp/[::]:7501", "tcp/127.0.0.1:0"]}}
    file.write_text(json.dumps(told | {"connect": {"endpoints": ["tcp/10.0.0.7:7447"]}}))
    assert service_endpoints(file) == ["tcp/127.0.0.1:7500", "tcp/[::1]:7501", "tcp/10.0.0.7:7447"]
    assert service_endpoints(None) == ["tcp/127.0.0.1:7447"]


def test_the_rviz_file_shows_topics_that_there_are():
    shown = YAML(typ="safe").load((DEPLOY / "lidarboost.rviz").read_text())["Visualization Manager"]
    topics = {topic.full("/lidarboost"): topic for topic in ROS_TOPICS.values()}
    displays = [display for display in shown["Displays"] if "Topic" in display]
    assert len(displays) == 4
    for display in displays:
        told = display["Topic"]
        assert told["Reliability Policy"] == "Reliable"
        assert told["Durability Policy"] == "Volatile" or topics[told["Value"]].latched
    assert shown["Global Options"]["Fixed Frame"] == "rig"


@pytest.mark.parametrize("name", ["ros2-rig.json5", "ros2-laptop.json5"])
def test_the_zenoh_files_are_such(name):
    config = zenoh.Config.from_file(DEPLOY / name)
    assert json.loads(config.get_json("namespace") or "null") is None


@pytest.mark.parametrize("namespace", ["lidarboost", "/a/", "/a b", "//a", "/1a", ""])
def test_a_namespace_that_ros_would_refuse_is_refused(namespace):
    with pytest.raises(ConfigurationError, match=r"ros2\.namespace"):
        load(None, {"ros2": {"namespace": namespace}})
