"""What the shipped depth camera has in view during the shipped climb: steel, and hardly the robot itself."""

import numpy as np
import pytest

from cli.trajectory_check import initial_stance
from services.player.trajectory import ChangeFoot, read_trajectory
from services.sensors.depth.pinhole import Pinhole
from services.sensors.rays.embree import EmbreeBackend
from services.sensors.rays.interface import Poses
from services.sensors.scene import scene_of
from shared.geometry import SE3
from shared.robot.kinematics import LINKS
from shared.robot.urdf import parse_urdf
from shared.runtime.config_loading import load_config
from shared.world.urdf_format import structure_urdf
from tests.support.robots import MODEL, ORIGINAL

CONFIG = load_config()
CAMERA = Pinhole(height=30, width=53, fx=26.7, fy=26.7, cx=26.0, cy=14.5)
"""A D435i at 848x480, a sixteenth of its size."""


def postures():
    """T_world_link by link, where each row of the climb ends."""
    stance, q = initial_stance(CONFIG), np.zeros(8)
    for row in read_trajectory(CONFIG.player.trajectory):
        if isinstance(row, ChangeFoot):
            stance = stance.changed(q)
            continue
        q = row.q
        T_world = dict(zip(LINKS, map(SE3.projected, stance.T_world_links(q)), strict=True))
        for joint in MODEL.joints:
            if joint.kind == "fixed":
                T_world[joint.child] = T_world[joint.parent] @ joint.T_parent_child()
        yield T_world | {"world": SE3.identity()}


@pytest.fixture(scope="module")
def shares():
    """(rows, 2): of the pixels of each image, which have steel at 0.3 to 3 m, and which have the robot."""
    world = parse_urdf(structure_urdf(ORIGINAL), "structure")
    scene = scene_of([*world.shapes, *MODEL.shapes])
    backend = EmbreeBackend()
    backend.set_scene(scene)
    rows = []
    for T_world in postures():
        eye, links = T_world["depth_optical"], [T_world[link] for link in scene.links]
        rotations, translations_m = (
            np.array([[getattr(T, name) for T in links]]) for name in ("rotation", "translation")
        )
        poses = Poses(eye.rotation[None], eye.translation[None], rotations, translations_m)
        hits = backend.image(CAMERA, poses, 0.05, 20.0)
        is_hit = hits.face >= 0
        is_robot = is_hit & (scene.shape[hits.face] >= len(world.shapes))
        is_steel = is_hit & ~is_robot & (hits.range_m >= 0.3) & (hits.range_m <= 3.0)
        rows.append((is_steel.mean(), is_robot.mean()))
    return np.array(rows)


def test_it_sees_steel_all_the_way(shares):
    assert shares[:, 0].min() > 0.1
    assert shares[:, 0].mean() > 0.3


def test_the_robot_hardly_stands_in_its_own_view(shares):
    assert shares[:, 1].max() < 0.1
    assert shares[:, 1].mean() < 0.01
