from pathlib import Path

from drivers.messages import FrameFields, json_schema
from service.messages.progress import ScanProgress
from service.messages.report import BurstReport
from service.messages.status import Status
from service.messages.topics import TOPICS, Congestion, topic_table

ROOT = Path(__file__).parents[2]


def test_the_page_for_subscribers_shows_the_table() -> None:
    assert topic_table() in (ROOT / "service" / "messages" / "README.md").read_text(encoding="utf-8")


def test_json_topics_name_the_schemas_of_their_models() -> None:
    models = {
        "camera/frame": FrameFields,
        "fused/report": BurstReport,
        "status": Status,
        "scan/progress": ScanProgress,
    }
    assert {topic: json_schema(model).name for topic, model in models.items()} == {
        topic: TOPICS[topic].schema for topic in models
    }


def test_late_subscribers_find_everything_that_describes_the_last_map() -> None:
    kept = {topic.name for topic in TOPICS.values() if topic.latest}
    assert {name for name in TOPICS if name.startswith("fused/")} | {"camera/calibration", "status"} <= kept


def test_nothing_but_images_and_what_belongs_to_a_frame_may_be_dropped() -> None:
    dropped = {topic.name for topic in TOPICS.values() if topic.congestion is Congestion.DROP}
    assert dropped == {
        "camera/distance",
        "camera/amplitude",
        "camera/frame",
        "stage/transform",
        "fused/depth",
        "fused/deviation",
        "fused/depth_mm",
        "fused/amplitude",
        "fused/points",
        "fused/reason",
        "scan/progress",
    }
