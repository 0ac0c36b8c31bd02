"""A slow climb with physics goes where the same climb without goes."""

import numpy as np
import pytest

from cli.offline import climb_messages
from services.player.player import Player
from services.player.trajectory import read_trajectory
from shared.messaging.frames import FrameTree
from shared.messaging.messages import Event, LegState, Severity, Transforms
from shared.runtime.config import CONFIGS_DIR
from shared.runtime.config_loading import load_config
from tests.support.robots import MODEL


def climbed(mode, trajectory):
    """T_world_link of every link (L, 4, 4) at each change of foot and at the end; leg states; errors."""
    path = CONFIGS_DIR / "trajectories" / trajectory
    settings = [f"sim.mode={mode}", f"player.trajectory={path}", "player.speed_radps=0.3"]
    config = load_config(overrides=settings)
    player = Player(config.player, read_trajectory(config.player.trajectory))
    stops, legs, errors, transforms = [], [], [], None
    for message in climb_messages(config, player):
        match message:
            case Transforms():
                transforms = message
            case LegState():
                if legs and message.fixed_foot is not legs[-1].fixed_foot:
                    stops.append(transforms)
                legs.append(message)
            case Event(severity=Severity.ERROR):
                errors.append(message.text)
    places = [np.array([FrameTree(each).T_root(link).matrix for link in MODEL.links]) for each in [*stops, transforms]]
    return np.array(places), legs, errors


@pytest.mark.parametrize("trajectory", ["along_bar.csv", "round_post.csv"])
def test_both_modes_agree_within_a_millimetre_wherever_the_robot_stands(trajectory):
    kinematic, _, _ = climbed("kinematic", trajectory)
    dynamic, legs, errors = climbed("dynamic", trajectory)
    assert errors == []
    assert kinematic.shape == dynamic.shape
    assert np.linalg.norm(kinematic[..., :3, 3] - dynamic[..., :3, 3], axis=-1).max() < 1e-3
    margins = [state.margin for state in legs if state.margin is not None]
    assert 0 < min(margins) < 0.6
    assert {len(state.holding) for state in legs} == {1, 2}
