"""Views for the camera's tests: the original world with the robot in it, random places in it, both backends' images."""

from pathlib import Path

import numpy as np

from services.sensors.depth.pinhole import Pinhole
from services.sensors.rays.interface import Poses
from services.sensors.scene import Scene, scene_of
from shared.geometry import SE3
from shared.robot.description import Shape
from shared.robot.urdf import parse_urdf
from shared.runtime.section import CONFIGS_DIR
from shared.solids import Solid
from shared.world.files import load_structure
from shared.world.urdf_format import structure_urdf

STAND = SE3.from_rpy((0.0, 0.0, 1.57), (0.0, -0.775, 10.1117))
"""Where foot A stands in the original world."""


def pinhole(width: int, height: int, fov_deg: float = 89.6) -> Pinhole:
    focal_px = width / 2 / np.tan(np.deg2rad(fov_deg) / 2)
    return Pinhole(height, width, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2)


def original_world() -> tuple[Scene, dict[str, SE3]]:
    """The scene of structure and robot, and T_world_link of its links."""
    structure = parse_urdf(structure_urdf(load_structure(CONFIGS_DIR / "structures" / "original.yaml")), "structure")
    robot = parse_urdf(Path(CONFIGS_DIR / "robot" / "hyrecro.urdf").read_text(), "robot")
    T_world_link = {structure.root: SE3.identity(), robot.root: STAND}
    while missing := [joint for joint in robot.joints if joint.child not in T_world_link]:
        for joint in missing:
            if joint.parent in T_world_link:
                T_world_link[joint.child] = T_world_link[joint.parent] @ joint.T_parent_child()
    return scene_of((*structure.shapes, *robot.shapes)), T_world_link


def scene_of_solids(*solids: tuple[Solid, SE3]) -> Scene:
    return scene_of([Shape(link="world", solid=solid, T_link_shape=pose) for solid, pose in solids])


def poses(scene: Scene, T_world_camera: SE3, T_world_link: dict[str, SE3] | None = None) -> Poses:
    links = [(T_world_link or {}).get(link, SE3.identity()) for link in scene.links]
    return Poses(
        sensor_rotation=T_world_camera.rotation[np.newaxis],
        sensor_translation_m=T_world_camera.translation[np.newaxis],
        link_rotation=np.array([[pose.rotation for pose in links]]).reshape(1, -1, 3, 3),
        link_translation_m=np.array([[pose.translation for pose in links]]).reshape(1, -1, 3),
    )


def random_view(rng: np.random.Generator, centre_m: np.ndarray, spread_m: float) -> SE3:
    """Anywhere near a point, looking anywhere."""
    axis = rng.normal(size=3)
    turn = rng.uniform(0, np.pi) * axis / np.linalg.norm(axis)
    return SE3(SE3.exp(np.concatenate([np.zeros(3), turn])).rotation, centre_m + rng.normal(size=3) * spread_m)
