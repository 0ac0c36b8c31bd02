from dataclasses import replace

import numpy as np
import pytest

from shared.errors import MessageError
from shared.geometry import SE3
from shared.messaging.frames import FrameTree, motion_of
from shared.messaging.messages import Transforms


def tree(*edges):
    poses = [T.xyz_quat_xyzw for _, _, T in edges]
    return FrameTree(
        Transforms(
            stamp_ns=0,
            seq=0,
            frame="world",
            parents=tuple(parent for parent, _, _ in edges),
            children=tuple(child for _, child, _ in edges),
            T_parent_child=np.array(poses),
        )
    )


def test_edges_are_composed_from_the_root():
    T_world_a, T_a_b = SE3.trans(1.0, 2.0, 3.0) @ SE3.rot("z", 0.4), SE3.rot("x", -0.3) @ SE3.trans(0.5)
    frames = tree(("a", "b", T_a_b), ("world", "a", T_world_a))
    np.testing.assert_allclose(frames.T_root("b").matrix, (T_world_a @ T_a_b).matrix, atol=1e-12)
    np.testing.assert_allclose(frames.T_root("world").matrix, np.eye(4))


def arm(stamp_ns, angle_rad, parents=("world", "a", "world")):
    poses = [
        SE3.trans(1.0, angle_rad) @ SE3.rot("z", angle_rad),
        SE3.rot("x", -angle_rad) @ SE3.trans(0.5),
        SE3.trans(z_m=2),
    ]
    return Transforms(
        stamp_ns=stamp_ns,
        seq=0,
        frame="world",
        parents=parents,
        children=("a", "b", "c"),
        T_parent_child=np.array([pose.xyz_quat_xyzw for pose in poses]),
    )


@pytest.mark.parametrize("num", [1, 2, 5])
@pytest.mark.parametrize("parents", [("world", "a", "world"), ("world", "a", "a")])
def test_the_motion_of_frames_is_that_of_their_trees(num, parents):
    messages = [arm(i * 10, 0.3 * i) for i in range(num - 1)] + [arm(100, 1.0, parents)]
    R, t = motion_of(messages, ["c", "b", "world"]).at([each.stamp_ns for each in messages])
    for i, each in enumerate(messages):
        for k, frame in enumerate(("c", "b", "world")):
            expected = FrameTree(each).T_root(frame)
            np.testing.assert_allclose(R[i, k], expected.rotation, atol=1e-12)
            np.testing.assert_allclose(t[i, k], expected.translation, atol=1e-12)


@pytest.mark.parametrize("num", [1, 3])
def test_quaternions_that_are_not_quite_of_length_1_are_rotations_still(num):
    messages = [arm(i * 10, 0.5) for i in range(num)]
    poses = np.array(messages[0].T_parent_child) * [1, 1, 1, *[1.0009] * 4]
    off = [replace(each, T_parent_child=poses) for each in messages]
    for frame in ("a", "b"):
        expected = FrameTree(messages[0]).T_root(frame)
        np.testing.assert_allclose(FrameTree(off[0]).T_root(frame).matrix, expected.matrix, atol=1e-12)
        R, t = motion_of(off, [frame]).at([0])
        np.testing.assert_allclose(R[0, 0], expected.rotation, atol=1e-12)
        np.testing.assert_allclose(t[0, 0], expected.translation, atol=1e-12)


def test_a_motion_of_unknown_frames_or_of_nothing():
    with pytest.raises(MessageError, match="no path from 'world' to frame 'd'"):
        motion_of([arm(0, 0.1), arm(1, 0.2), arm(2, 0.3)], ["d"])
    with pytest.raises(ValueError, match="motion"):
        motion_of([], ["a"])


def test_an_unknown_frame_is_named():
    with pytest.raises(MessageError, match="no path from 'world' to frame 'c'"):
        tree(("world", "a", SE3.identity())).T_root("c")


def test_a_loop_ends():
    with pytest.raises(MessageError, match="no path"):
        tree(("a", "b", SE3.identity()), ("b", "a", SE3.identity())).T_root("a")
