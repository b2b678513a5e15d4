"""How Rerun shows a recording or a rig: the map as a depth image where it belongs, with what led to it."""

from typing import Any

from service.errors import ConfigurationError

_NEAREST, _FARTHEST = 500, 4000
"""Millimetres that the colours span; the viewer's panel changes it."""

_EYE, _TARGET = (-1.2, 0.0, 0.6), (2.5, 0.0, 0.0)
"""Where one looks from and at, metres in `rig`: from behind the camera, a little above."""


def rerun() -> Any:
    """The library; raises `ConfigurationError` where it is not installed."""
    try:
        import rerun
    except ImportError as error:
        raise ConfigurationError(
            "the viewer needs the library rerun-sdk: pip install 'lidarboost[rerun]'"
        ) from error
    return rerun


def blueprint() -> Any:
    """Map and camera in 3-D beside the images, the log and the camera's amplitude.

    `fused/depth_mm` is a RawImage, which Rerun takes for a picture; here its pixels are read as depths.
    """
    rr = rerun()
    import rerun.blueprint as rrb
    from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

    source = ComponentSourceKind.SourceComponent
    depth = rr.DepthImage.from_fields(
        meter=1000.0, colormap="turbo", depth_range=[_NEAREST, _FARTHEST], point_fill_ratio=0.5
    ).visualizer(
        mappings=[
            VisualizerComponentMapping(f"DepthImage:{part}", source, source_component=f"Image:{part}")
            for part in ("buffer", "format")
        ]
    )
    mapped: Any = {"/fused/depth_mm": depth}
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                origin="/",
                name="map",
                contents=[
                    "/camera/calibration",
                    "/stage/**",
                    "/fused/calibration",
                    "/fused/transform",
                    "/fused/depth_mm",
                ],
                overrides=mapped,
                spatial_information=rrb.SpatialInformation(target_frame="rig"),
                eye_controls=rrb.EyeControls3D(position=_EYE, look_target=_TARGET, eye_up=(0, 0, 1)),
            ),
            rrb.Vertical(
                rrb.Spatial2DView(origin="/fused/depth_mm", name="fused depth", overrides=mapped),
                rrb.Spatial2DView(origin="/camera/amplitude", name="amplitude of a frame"),
                rrb.TextLogView(origin="/log", name="log"),
            ),
            column_shares=[3, 2],
        ),
        collapse_panels=True,
    )
