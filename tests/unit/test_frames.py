import numpy as np
import pytest

from shared.errors import MessageError
from shared.geometry import SE3
from shared.messaging.frames import FrameTree
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


def test_an_unknown_frame_is_named():
    with pytest.raises(MessageError, match="no path from 'world' to frame 'c'"):
        tree(("world", "a", SE3.identity())).T_root("c")


def test_a_loop_ends():
    with pytest.raises(MessageError, match="no path"):
        tree(("a", "b", SE3.identity()), ("b", "a", SE3.identity())).T_root("a")
