"""The layout of the scene in Rerun: everything in space on the left, image, curves and words beside it."""

from __future__ import annotations

import rerun as rr
import rerun.blueprint as rrb
from rerun.encodings import TimeRangeBoundary

from services.viewer import colours
from services.viewer.canvas import TIMELINE
from services.viewer.scene import ESTIMATED_TRAIL, FIXED_FOOT_STATE, ROBOT, TRUE_TRAIL
from shared.messaging import channels as c
from shared.messaging.channels import Channel
from shared.messaging.messages import JOINT_NAMES

_WORLD_FRAME, _MAP_FRAME = "world", "map"
_EYE_TARGET_M = (0.0, -0.775, 10.25)
_EYE_POSITION_M = (0.85, -1.95, 10.85)
"""World: about 1.6 metres from the first foothold in the original world. When following, only the offset counts."""
_FOLLOWED = f"/{ROBOT}/hyrecro/visual_geometries/hip/visual_0"
"""Where Rerun puts the first visual of link `hip` of the URDF called `hyrecro`: the eye follows it."""


def robot_layout() -> rrb.Blueprint:
    """The layout for a robot, live or recorded. What it does not send leaves its place empty."""
    status, metrics, legs = c.MAP_STATUS.key, c.EVAL_METRICS.key, c.LEG_STATE.key
    curves = rrb.Vertical(
        _joints_view(),
        rrb.StateTimelineView(origin=FIXED_FOOT_STATE, name="Fixed foot"),
        _curves("Registration (ms)", status, "registration_ms", "lag_ms"),
        _curves("Score (0..1), scans lost", status, "score", "lost_scans"),
        _curves("Slip, error against the truth (mm)", "/", f"{status}/slip_mm", f"{metrics}/last_error_mm"),
        _curves("Holding margin (1 unloaded, 0 lets go)", legs, "margin"),
        row_shares=[3, 1.4, 1.8, 1.8, 1.8, 1.8],
    )
    depth = rrb.Spatial2DView(origin=c.DEPTH_IMAGE.key, name="Depth")
    words = _words_view(c.EVENTS, c.FOOT_STATUS, c.RECORDER_STATUS)
    space = _space_view(_WORLD_FRAME, _robot_eye())
    return _blueprint(
        rrb.Vertical(space, rrb.Horizontal(depth, words, column_shares=[2, 3]), row_shares=[3, 1]), curves
    )


def map_layout() -> rrb.Blueprint:
    """The layout for a mapper alone, which knows neither robot nor truth."""
    status = c.MAP_STATUS.key
    curves = rrb.Vertical(
        _curves("Registration (ms)", status, "registration_ms"),
        _curves("Score (0..1), scans lost", status, "score", "lost_scans"),
        _words_view(c.EVENTS),
    )
    return _blueprint(_space_view(_MAP_FRAME), curves)


def _blueprint(space: rrb.View | rrb.Container, curves: rrb.Container) -> rrb.Blueprint:
    return rrb.Blueprint(
        rrb.Horizontal(space, curves, column_shares=[3, 2]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
    )


def _space_view(root_frame: str, eye: rrb.EyeControls3D | None = None) -> rrb.Spatial3DView:
    """Everything that has a place. Trails are drawn from their beginning up to the time that is shown."""
    so_far = rrb.VisibleTimeRanges(
        timeline=TIMELINE, start=TimeRangeBoundary.infinite(), end=TimeRangeBoundary.cursor_relative()
    )
    return rrb.Spatial3DView(
        origin="/",
        contents=["/**", f"- /{c.DEPTH_IMAGE.key}"],
        name="Scan by range, map, planes, trajectory (pink) on the truth (white)",
        defaults=[rr.Boxes3D.from_fields(fill_mode="solid"), rr.Cylinders3D.from_fields(fill_mode="solid")],
        overrides={TRUE_TRAIL: so_far, ESTIMATED_TRAIL: so_far},
        spatial_information=rrb.SpatialInformation(target_frame=root_frame, show_axes=False),
        eye_controls=eye,
        background=colours.BACKGROUND,
        line_grid=False,
    )


def _robot_eye() -> rrb.EyeControls3D:
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=_EYE_POSITION_M,
        look_target=_EYE_TARGET_M,
        eye_up=(0.0, 0.0, 1.0),
        tracking_entity=_FOLLOWED,
    )


def _words_view(*channels: Channel) -> rrb.TextLogView:
    columns = rrb.TextLogColumns(timeline_columns=[TIMELINE], text_log_columns=["loglevel", "body"])
    return rrb.TextLogView(
        origin="/", contents=[f"/{channel.key}" for channel in channels], name="Events", columns=columns
    )


def _joints_view() -> rrb.TimeSeriesView:
    joints = rr.SeriesLines.from_fields(names=JOINT_NAMES, colors=colours.JOINTS).visualizer()
    name = "Joints (rad; q2, q7 in m)"
    return rrb.TimeSeriesView(origin=c.JOINTS_STATE.key, name=name, overrides={c.JOINTS_STATE.key: joints})


def _curves(name: str, origin: str, *names: str) -> rrb.TimeSeriesView:
    root = f"/{origin}".rstrip("/")
    return rrb.TimeSeriesView(origin=f"/{origin}", contents=[f"{root}/{each}" for each in names], name=name)
