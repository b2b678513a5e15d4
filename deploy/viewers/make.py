"""Makes the layouts for Foxglove and Lichtblick and the Rerun blueprint beside this file.

Needs lidarboost[foxglove,rerun]:  python deploy/viewers/make.py
"""

import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent

NEAREST, FARTHEST = 500.0, 4000.0
"""Millimetres that the colours span."""

BRIGHTEST = 4000.0
"""Counts of amplitude shown as white."""

CLOUD = {"pointSize": 2.0, "colorMode": "colormap", "colorField": "amplitude", "colorMap": "turbo"}


def lichtblick() -> str:
    """A layout that Lichtblick imports, as its version 1.28 reads it."""
    panels: dict[str, Any] = {
        "3D!map": {
            "followTf": "rig",
            "followMode": "follow-none",
            "scene": {"enableStats": False},
            "topics": {
                "/fused/points": {"visible": True, **CLOUD},
                "/fused/calibration": {"visible": True, "color": "#8bc34a"},
                "/camera/calibration": {"visible": True, "color": "#9e9e9e"},
            },
        },
        "Image!depth": _image("/fused/depth_mm", "/fused/calibration", "colormap", NEAREST, FARTHEST),
        "Image!amplitude": _image("/camera/amplitude", "/camera/calibration", "gradient", 0.0, BRIGHTEST),
        "RosOut!log": {"topicToRender": "/log", "minLogLevel": 2, "searchTerms": []},
        "RawMessages!report": {"topicPath": "/fused/report"},
    }
    right = {
        "first": "Image!depth",
        "second": {"first": "Image!amplitude", "second": "RosOut!log", "direction": "column"},
        "direction": "column",
        "splitPercentage": 40,
    }
    left = {"first": "3D!map", "second": "RawMessages!report", "direction": "column", "splitPercentage": 75}
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"first": left, "second": right, "direction": "row", "splitPercentage": 62},
    }
    return json.dumps(layout, indent=2) + "\n"


def _image(topic: str, calibration: str, colours: str, least: float, most: float) -> dict[str, Any]:
    mode = {"imageTopic": topic, "calibrationTopic": calibration, "colorMode": colours, "colorMap": "turbo"}
    return {"imageMode": {**mode, "gradient": ["#000000", "#ffffff"], "minValue": least, "maxValue": most}}


def foxglove() -> str:
    """The same for Foxglove, by its own library."""
    from foxglove import layouts as fg

    cloud = fg.BaseRendererPointCloudTopicSettings(
        visible=True, point_size=2.0, color_mode="colormap", color_field="amplitude", color_map="turbo"
    )
    map_panel = fg.ThreeDeePanel(
        title="map",
        config=fg.ThreeDeeConfig(
            follow_tf="rig",
            follow_mode="follow-none",
            topics={
                "/fused/points": cloud,
                "/fused/calibration": fg.BaseRendererCameraTopicSettings(visible=True, color="#8bc34a"),
                "/camera/calibration": fg.BaseRendererCameraTopicSettings(visible=True, color="#9e9e9e"),
            },
        ),
    )
    depth = fg.ImagePanel(
        title="fused depth, mm",
        config=fg.ImageConfig(
            image_mode=fg.ImageModeConfig(
                image_topic="/fused/depth_mm",
                calibration_topic="/fused/calibration",
                color_mode="colormap",
                color_map="turbo",
                min_value=NEAREST,
                max_value=FARTHEST,
            )
        ),
    )
    amplitude = fg.ImagePanel(
        title="amplitude of a frame",
        config=fg.ImageConfig(
            image_mode=fg.ImageModeConfig(
                image_topic="/camera/amplitude",
                calibration_topic="/camera/calibration",
                color_mode="gradient",
                gradient=("#000000", "#ffffff"),
                min_value=0.0,
                max_value=BRIGHTEST,
            )
        ),
    )
    log = fg.LogPanel(config=fg.LogConfig(topic_to_render="/log", min_log_level=2))
    right = fg.SplitContainer(
        direction="column",
        items=[
            fg.SplitItem(proportion=2, content=depth),
            fg.SplitItem(proportion=2, content=amplitude),
            fg.SplitItem(proportion=1, content=log),
        ],
    )
    both = [fg.SplitItem(proportion=3, content=map_panel), fg.SplitItem(proportion=2, content=right)]
    layout = fg.Layout(content=fg.SplitContainer(direction="row", items=both))
    return json.dumps(json.loads(layout.to_json()), indent=2) + "\n"


def main() -> None:
    """Write all three."""
    from service.jobs.rerun_blueprint import blueprint

    (FOLDER / "lichtblick.json").write_text(lichtblick(), encoding="utf-8")
    (FOLDER / "foxglove.json").write_text(foxglove(), encoding="utf-8")
    blueprint().save("lidarboost", str(FOLDER / "rerun.rbl"))


if __name__ == "__main__":
    main()
