"""What the page is made of: postures, slider scales, texts, bodies, the player as a child."""

import sys
from pathlib import Path

import numpy as np
import pytest

from services.teleop import texts
from services.teleop.bodies import bodies_of, height_shades, thinned
from services.teleop.player import PlayerProcess
from services.teleop.postures import read_postures
from services.teleop.sliders import joint_scales
from services.teleop.teleop import Line
from shared.climbing.steel import SoleContact
from shared.errors import InputFileError
from shared.messaging.messages import Foot, Severity
from shared.robot.limits import joint_bounds
from shared.runtime.config import CONFIGS_DIR, MagnetConfig
from shared.world.urdf_format import structure_urdf
from tests.support.processes import wait_until
from tests.support.robots import MODEL, ORIGINAL, URDF

LOWER, UPPER = joint_bounds(MODEL)
HEADER = "name,q1,q2,q3,q4,q5,q6,q7,q8\n"


def test_the_shipped_postures_are_within_the_limits():
    postures = read_postures(CONFIGS_DIR / "postures.csv", LOWER, UPPER)
    assert next(iter(postures)) == "home"
    np.testing.assert_array_equal(postures["home"], np.zeros(8))
    np.testing.assert_array_equal(postures["stride"], [-0.6, 0, 0.6, 0, 0, 0.6, 0, -0.6])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", ":1: the header must be name,q1"),
        ("q1,q2\n", ":1: the header must be name,q1"),
        (HEADER, "there is no posture in it"),
        (HEADER + "home,0,0\n", ":2: a name and 8 values are needed, got 2 values"),
        (HEADER + ",0,0,0,0,0,0,0,0\n", ":2: a name and 8 values are needed"),
        (HEADER + "\nhome,0,0,0,x,0,0,0,0\n", ":3: q4 is 'x', must be a finite number"),
        (HEADER + "home,0,0,0,nan,0,0,0,0\n", ":2: q4 is 'nan', must be a finite number"),
        (HEADER + 2 * "home,0,0,0,0,0,0,0,0\n", ":3: posture 'home' is there twice"),
        (HEADER + "far,9,0,0,0,0,0,0,0\n", ":2: posture 'far': q1 is 9 rad, must be within -1.5708..1.5708 rad"),
    ],
)
def test_postures_that_cannot_be_used_are_refused(tmp_path, text, reason):
    path = tmp_path / "postures.csv"
    path.write_text(text)
    with pytest.raises(InputFileError) as error:
        read_postures(path, LOWER, UPPER)
    assert str(path) in str(error.value)
    assert reason in str(error.value)


def test_sliders_are_in_degrees_and_millimetres_within_the_limits():
    scales = joint_scales(LOWER, UPPER)
    assert [(scale.name, scale.unit, scale.low, scale.high) for scale in scales[:2]] == [
        ("q1", "\u00b0", -90.0, 90.0),
        ("q2", "mm", -25.0, 25.0),
    ]
    for joint, scale in enumerate(scales):
        for shown in (scale.low, scale.high):
            assert LOWER[joint] <= scale.si(shown) <= UPPER[joint]
            assert scale.shown(scale.si(shown)) == pytest.approx(shown)
    assert scales[0].shown(1.5708) == 90.0
    assert scales[1].label(-0.01234) == "q2 -12.3 mm"
    assert scales[0].label(-1e-9) == "q1 0.0 \u00b0"


def test_what_comes_from_outside_is_escaped():
    line = Line(0, Severity.ERROR, "<b>sim</b>", "<script>alert(1)</script>")
    for shown in (texts.log_html([line]), texts.last_warning([line])):
        assert "<script>" not in shown
        assert "<b>" not in shown


def test_only_warnings_stand_at_the_top():
    info = Line(0, Severity.INFO, "sim", "fine")
    assert texts.last_warning([info]) == ""
    assert "bad" in texts.last_warning([Line(0, Severity.WARNING, "sim", "bad"), info])


@pytest.mark.parametrize(
    ("contact", "expected"),
    [
        (SoleContact(np.inf, np.pi, 0.0, ()), "no steel within 20 mm"),
        (SoleContact(0.001, 0.01, 1.0, ("bar",)), "foot B would hold: 100 % of its sole over steel, gap 1.0 mm, 0.6"),
        (SoleContact(0.005, 0.01, 1.0, ("bar",)), "would not hold"),
        (SoleContact(0.0, 0.0, 0.6, ("bar",)), "60 % of its sole"),
    ],
)
def test_a_change_of_foot_is_told_beforehand(contact, expected):
    assert expected in texts.change_text(Foot.B, contact, MagnetConfig())


def test_services_are_alive_or_silent():
    shown = texts.services_text({"sim": 0.5, "mapper": 12.0})
    assert "sim" in shown
    assert "mapper silent 12 s" in shown
    assert "sim silent" not in shown


def test_every_link_that_can_be_seen_has_a_body():
    bodies = bodies_of(URDF, "robot")
    assert {body.link for body in bodies} == {shape.link for shape in MODEL.shapes}
    assert sum(len(body.triangles) for body in bodies) > 100
    assert bodies[0].colour == (46, 51, 59), "the material dark_steel"


def test_a_structure_is_drawn_in_a_few_pieces():
    bodies = bodies_of(structure_urdf(ORIGINAL), "structure")
    assert len(bodies) == 2, "steel and ground"
    assert sum(len(body.triangles) for body in bodies) == 12 * (len(ORIGINAL.members) + 1)


def test_clouds_are_thinned_evenly():
    cloud = np.arange(300, dtype=np.float32).reshape(100, 3)
    assert len(thinned(cloud, 30)) == 25
    assert thinned(cloud, 100) is not None
    assert len(thinned(cloud, 1000)) == 100
    assert len(thinned(cloud[:0], 10)) == 0
    np.testing.assert_allclose(height_shades(cloud)[[0, -1]], [0, 1])


def test_a_player_says_how_it_ended(tmp_path):
    player = PlayerProcess({"bad": tmp_path / "none.csv"}, [])
    ending = wait_until(lambda: player.follow("bad"), "the end of the player")
    assert ending.startswith("trajectory bad: ")
    assert "none.csv" in ending
    assert player.follow(None) is None


def test_a_player_is_ended_with_what_wanted_it():
    path = Path(CONFIGS_DIR / "trajectories" / "climb.csv")
    player = PlayerProcess(
        {"climb": path}, ["--set", "bus.endpoint=tcp/127.0.0.1:9", "--set", "bus.connect_timeout_s=60"]
    )
    assert player.follow("climb") is None
    process = player._run.process
    assert process.poll() is None
    player.follow(None)
    assert process.poll() is not None
    assert sys.executable in process.args
