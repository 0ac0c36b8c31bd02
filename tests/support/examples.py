"""One small example of every message."""

import numpy as np

from shared.messaging import messages as m

_POSE = np.array([1.0, -2.0, 0.5, 0.0, 0.6, 0.0, 0.8])
_AT = {"stamp_ns": 1_500_000_000, "seq": 7}

_PLANE = m.Plane(
    id=3,
    coefficients=np.array([0.0, 0.0, 1.0, -2.0]),
    num_inliers=500,
    outline_m=np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 1.0, 2.0]]),
    colour=np.array([0.5, 0.25, 1.0]),
)
EXAMPLES: tuple[m.Message, ...] = (
    m.JointTarget(q=np.linspace(-0.4, 0.4, 8), duration_s=2.5),
    m.LegTarget(foot=m.Foot.B),
    m.ActuatorTarget(positions=np.array([0.22, 0.1]), names=("a1_l", "th_a"), duration_s=1.5),
    m.FootTarget(foot=m.Foot.B, T_world_foot=_POSE),
    m.FootTarget(point_m=np.array([0.0, 1.5, 10.1]), normal=np.array([0.0, 0.0, 2.0])),
    m.SimControl(action=m.SimAction.STEP, num_steps=10),
    m.SimControl(seed=5, real_time_factor=0.5),
    m.JointState(**_AT, frame="foot_a", q=np.arange(8.0), dq=np.zeros(8)),
    m.ActuatorState(**_AT, frame="foot_a", positions=np.linspace(0.2, 0.24, 10), velocities=np.zeros(10)),
    m.LegState(**_AT, frame="world", fixed_foot=m.Foot.A, T_world_foot=_POSE),
    m.LegState(
        **_AT,
        frame="world",
        fixed_foot=m.Foot.A,
        T_world_foot=_POSE,
        has_contact=True,
        holding=(m.Foot.A, m.Foot.B),
        wrench=np.arange(6.0),
        load_n=20.0,
        margin=0.4,
    ),
    m.FootStatus(**_AT, frame="world", foot=m.Foot.B, phase=m.FootPhase.LIFT, progress=0.25, T_world_goal=_POSE),
    m.Transforms(
        **_AT, frame="world", parents=("world", "a"), children=("a", "b"), T_parent_child=np.stack([_POSE] * 2)
    ),
    m.Clock(**_AT, frame="world"),
    m.RobotDescription(**_AT, frame="foot_a", urdf="<robot name='r'><link name='foot_a'/></robot>"),
    m.FixedFootDescription(**_AT, frame="fixed_foot", urdf="<robot name='f'><link name='fixed_foot'/></robot>"),
    m.StructureDescription(**_AT, frame="world", urdf="<robot name='s'><link name='structure'/></robot>"),
    m.LidarScan(
        **_AT,
        frame="lidar",
        points_m=np.arange(12.0).reshape(4, 3),
        intensity=np.array([0.0, 1.0, 128.0, 255.0]),
        t_ns=np.zeros(4),
        ring=np.arange(4),
    ),
    m.LidarScan(
        **_AT,
        frame="lidar",
        points_m=np.arange(6.0).reshape(2, 3),
        intensity=np.array([0.0, 1.0]),
        t_ns=np.array([0, 97_700]),
        ring=np.arange(2),
        member=np.array([3, 4]),
        face=np.array([0, 5]),
        true_range_m=np.array([2.0, 3.0]),
    ),
    m.Imu(
        **_AT,
        frame="lidar",
        angular_velocity_radps=np.array([0.0, 0.1, 0.0]),
        linear_acceleration_mps2=np.array([0.0, 0.0, 9.81]),
    ),
    m.DepthImage(**_AT, frame="depth_optical", height=2, width=3, depth_mm=np.array([0, 300, 301, 1000, 2999, 3000])),
    m.CameraInfo(**_AT, frame="depth_optical", height=480, width=848, fx=427.0, fy=427.0, cx=423.5, cy=239.5),
    m.PointCloud(**_AT, frame="map", points_m=np.arange(6.0).reshape(2, 3)),
    m.Odometry(**_AT, frame="map", child_frame="lidar_estimated", T_frame_child=_POSE, covariance=np.eye(6)),
    m.MapStatus(
        **_AT,
        frame="map",
        scan_seq=7,
        method="gicp",
        prior="legs",
        is_tracking=True,
        is_suspect=False,
        registration_ms=8.5,
        lag_ms=12.0,
        num_iterations=5,
        num_points=2000,
        num_inliers=1900,
        score=0.9,
        fitness=1e-4,
        degenerate_axes=("z",),
        num_map_points=40_000,
        num_scans_missed=0,
        num_lost_scans=1,
        leg_slip_m=0.002,
    ),
    _PLANE,
    m.PlaneMap(**_AT, frame="map", planes=(_PLANE,)),
    m.TrackingMetrics(
        **_AT, frame="map", num_poses=3, ate_rmse_m=0.002, rpe_rmse_m=0.001, last_error_m=0.003, last_error_rad=0.001
    ),
    m.Event(**_AT, frame="", source="sim", severity=m.Severity.WARNING, text="q1 is 3.0: limits are -1.57 to 1.57"),
    m.ChannelCount(key="hyrecro/tf", num_received=5, num_missed=1, last_seq=6),
    m.Health(
        **_AT,
        frame="",
        service="sim",
        uptime_s=3.5,
        rss_bytes=50_000_000,
        busy_ratio=0.25,
        channels=(m.ChannelCount(key="hyrecro/tf", num_sent=350, last_seq=349),),
    ),
)
