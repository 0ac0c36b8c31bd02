"""The Rerun layout of a recording: robot, structure, scan and map in one 3D view beside the curves that matter.

Rerun 0.41 applies a layout to a recording of the same application id, which for an MCAP file is its name without the
suffix. The layout must come in a folder: a `.rbl` file named on the command line goes into the viewer's catalogue of
`.rrd` files and never meets an MCAP file.
"""

from __future__ import annotations

import re
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from shared.errors import InputFileError
from shared.messaging import channels as c
from shared.messaging.channels import Channel

TIMELINE = "message_log_time"
"""Rerun's name for MCAP's log_time: here the simulated time of measurement."""

LAYOUT_SUFFIX = ".rbl"
WORLD_FRAME = "world"

_APPLICATION_ID = re.compile(r"[A-Za-z0-9_-]{1,180}")
_ROBOT_ENTITY = "/hyrecro/visual_geometries/hip/visual_0"
"""Where Rerun puts the first visual of link `hip` of the URDF called `hyrecro`: the eye follows it."""

_EYE_TARGET_M = (0.0, -0.775, 10.25)
_EYE_POSITION_M = (1.1, -2.2, 10.95)
"""World: about two metres from the first foothold in the original world. When following, only the offset counts."""

_BACKGROUND_RGB = (18, 22, 26)
_SCAN_RGB = (110, 235, 140)
_MAP_RGB = (90, 160, 255)
_SCAN_RADIUS_UI_POINTS = 1.5
_MAP_RADIUS_M = 0.006
_CAMERA_SIZE_M = 0.1
"""Of the pyramid that stands for the depth camera."""


def write_layout(folder: Path, recording: Path) -> None:
    """Writes the layout for an MCAP file into a folder of its own, to be opened as `rerun RECORDING FOLDER`.

    Raises:
        InputFileError: the recording's name has characters that Rerun changes when it makes an application id of it.
    """
    if not _APPLICATION_ID.fullmatch(recording.stem):
        raise InputFileError(f"{recording}: the name must be of letters, digits, _ and - for Rerun to find its layout")
    folder.mkdir(parents=True, exist_ok=True)
    build_layout().save(recording.stem, folder / f"{recording.stem}{LAYOUT_SUFFIX}")


def build_layout() -> rrb.Blueprint:
    """The layout itself. What a recording does not hold leaves its place empty."""
    depth = rrb.Spatial2DView(origin=c.DEPTH_IMAGE.topic, name="Depth image")
    curves = rrb.Vertical(
        rrb.TimeSeriesView(origin=f"{c.JOINTS_STATE.topic}/position", name="Joints (rad; q2, q7 in m)"),
        _state_view(),
        _curve_view("Holding margin (1 unloaded, 0 lets go)", c.LEG_STATE, {"margin": "margin"}),
        _curve_view("Registration (ms)", c.MAP_STATUS, {"registration_ms": "registration", "lag_ms": "lag"}),
        _curve_view("Error of the estimate (m)", c.EVAL_METRICS, {"ate_rmse_m": "ATE", "last_error_m": "last"}),
        rrb.TextLogView(origin=c.EVENTS.topic, name="Events"),
        row_shares=[2.5, 1.4, 1.5, 1.7, 1.7, 1.6],
    )
    return rrb.Blueprint(
        rrb.Horizontal(_space_view(), rrb.Vertical(depth, curves, row_shares=[3, 10]), column_shares=[3, 2]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
    )


def _space_view() -> rrb.Spatial3DView:
    scan = rr.Points3D.from_fields(colors=_SCAN_RGB, radii=rr.Radius.ui_points(_SCAN_RADIUS_UI_POINTS))
    cloud = rr.Points3D.from_fields(colors=_MAP_RGB, radii=_MAP_RADIUS_M)
    camera = rr.Pinhole.from_fields(image_plane_distance=_CAMERA_SIZE_M)
    return rrb.Spatial3DView(
        origin="/",
        contents="/**",
        name="Robot, structure, scan (green), map (blue) and depth",
        defaults=[rr.Boxes3D.from_fields(fill_mode="solid"), rr.Cylinders3D.from_fields(fill_mode="solid")],
        overrides={
            c.LIDAR_POINTS.topic: scan.visualizer(),
            c.MAP_CLOUD.topic: cloud.visualizer(),
            c.DEPTH_CAMERA_INFO.topic: camera.visualizer(),
        },
        spatial_information=rrb.SpatialInformation(target_frame=WORLD_FRAME, show_axes=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=_EYE_POSITION_M,
            look_target=_EYE_TARGET_M,
            eye_up=(0.0, 0.0, 1.0),
            tracking_entity=_ROBOT_ENTITY,
        ),
        background=_BACKGROUND_RGB,
        line_grid=False,
    )


def _curve_view(name: str, channel: Channel, labels_by_field: dict[str, str]) -> rrb.TimeSeriesView:
    """Curves of numeric fields of the project's own ROS types."""
    curves = [
        rr.SeriesLines.from_fields(names=label).visualizer(mappings=[_field("Scalars:scalars", channel, field)])
        for field, label in labels_by_field.items()
    ]
    return rrb.TimeSeriesView(
        origin=channel.topic, contents=channel.topic, name=name, overrides={channel.topic: curves}
    )


def _state_view() -> rrb.StateTimelineView:
    """Which foot is fixed, over time."""
    foot = rr.StateChange.from_fields().visualizer(mappings=[_field("StateChange:state", c.LEG_STATE, "fixed_foot")])
    return rrb.StateTimelineView(
        origin=c.LEG_STATE.topic, contents=c.LEG_STATE.topic, name="Fixed foot", overrides={c.LEG_STATE.topic: foot}
    )


def _field(target: str, channel: Channel, field: str) -> VisualizerComponentMapping:
    """Draws `target` from one field: Rerun keeps a message of an unknown type as one struct component."""
    component = f"{channel.ros_type.replace('/', '.')}:message"
    return VisualizerComponentMapping(
        target, ComponentSourceKind.SourceComponent, source_component=component, selector=f".{field}"
    )
