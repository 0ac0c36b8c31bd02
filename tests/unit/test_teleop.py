import numpy as np
import pytest

from services.teleop import presses as p
from services.teleop.teleop import Teleop
from shared.messaging.channels import JOINTS_TARGET
from shared.messaging.messages import (
    Clock,
    Event,
    Foot,
    Health,
    JointState,
    JointTarget,
    LegTarget,
    RecorderAction,
    RecorderControl,
    Severity,
    SimAction,
    SimControl,
    Stop,
)
from shared.runtime.config import TeleopConfig

CONFIG = TeleopConfig(rate_hz=10, valid_s=0.5, silence_s=2.0, speed_share=0.5)
MAX_VELOCITY = np.array([1, 0.05, 1, 1, 1, 1, 0.05, 1])
STRIDE = np.array([-0.6, 0, 0.6, 0, 0, 0.6, 0, -0.6])
ME, OTHER = 1, 2


class Page:
    """A page whose browsers answer, and a robot that stands where it is told to; time goes on by ticks."""

    def __init__(self):
        self.teleop = Teleop(CONFIG, MAX_VELOCITY, {"stride": STRIDE}, ["climb"])
        self.now_s, self.q, self.pace = 0.0, np.zeros(8), 1.0
        self.press(p.Joined(ME))
        self.stand()

    def stand(self):
        stamp_ns = round(self.now_s * 1e9)
        self.teleop.note(JointState(stamp_ns=stamp_ns, seq=0, frame="", q=self.q, dq=np.zeros(8)))
        self.teleop.note(Clock(stamp_ns=stamp_ns, seq=0, frame="", real_time_factor=self.pace))

    def press(self, press):
        return self.teleop.press(press, self.now_s)

    def run(self, seconds, is_answering=True):
        """(time, message) of all that is sent meanwhile, at 50 ticks a second."""
        sent = []
        for _ in range(round(seconds * 50)):
            self.now_s += 0.02
            if is_answering:
                self.press(p.Heard(ME))
            self.stand()
            sent += [(self.now_s, message) for message in self.teleop.tick(self.now_s)]
        return sent

    def last_line(self):
        return self.teleop.lines[-1].text


@pytest.fixture
def page():
    return Page()


def targets_of(sent):
    return [message for _, message in sent if isinstance(message, JointTarget)]


def test_a_slider_that_moves_is_followed_at_the_chosen_speed(page):
    page.press(p.JointMoved(ME, 3, 0.4))
    target = targets_of(page.run(0.1))[0]
    assert target == JointTarget(q=[0.4], names=("q4",), duration_s=0.8, valid_s=0.5)
    page.press(p.SpeedSet(ME, 1.0))
    page.press(p.JointMoved(ME, 1, 0.025))
    target = targets_of(page.run(0.2))[-1]
    assert target == JointTarget(q=[0.025, 0.4], names=("q2", "q4"), duration_s=0.5, valid_s=0.5)


def test_the_same_target_is_sent_again_until_it_is_reached(page):
    page.press(p.JointMoved(ME, 3, 0.4))
    sent = page.run(3.0)
    targets = targets_of(sent)
    assert all(target == targets[0] for target in targets)
    times_s = np.array([time_s for time_s, _ in sent])
    assert np.diff(times_s).max() < 0.15
    assert times_s[-1] == pytest.approx(0.8 + 0.5, abs=0.15), "the motion, then a moment for drives that lag"
    assert not page.teleop.is_busy


def test_however_fast_a_slider_moves_targets_come_at_their_rate(page):
    sent = []
    for number in range(50):
        page.press(p.JointMoved(ME, 0, 0.01 * number))
        sent += page.run(0.02)
    assert 9 <= len(sent) <= 11


def test_a_target_holds_longer_where_simulated_time_runs_faster(page):
    page.pace = 4.0
    page.stand()
    page.press(p.JointMoved(ME, 3, 0.4))
    assert targets_of(page.run(0.1))[0].valid_s == 2.0


def test_without_following_the_sliders_wait_for_go(page):
    page.press(p.FollowingSet(ME, is_following=False))
    page.press(p.JointMoved(ME, 3, 0.4))
    page.press(p.JointMoved(ME, 0, 0.1))
    assert page.run(0.5) == []
    assert page.teleop.moved_joints == {0, 3}
    page.press(p.GoPressed(ME))
    assert targets_of(page.run(0.1))[0].names == ("q1", "q4")


def test_a_posture_moves_all_joints(page):
    page.press(p.PostureChosen(ME, "stride"))
    np.testing.assert_array_equal(targets_of(page.run(0.1))[0].q, STRIDE)


def test_what_is_asked_of_others_is_passed_on(page):
    pause, record = SimControl(action=SimAction.PAUSE), RecorderControl(action=RecorderAction.START)
    assert page.press(p.FootChosen(ME, Foot.B)) == [LegTarget(foot=Foot.B)]
    assert page.press(p.TimeAsked(ME, pause)) == [pause]
    assert page.press(p.RecordingAsked(ME, record)) == [record]


def test_the_stop_stops_and_nothing_is_renewed(page):
    page.press(p.JointMoved(ME, 3, 0.4))
    page.run(0.1)
    assert page.press(p.Stopped(ME, "STOP was pressed")) == [Stop(text="teleop, STOP was pressed")]
    assert page.run(1.0) == []


def test_a_stop_by_others_ends_what_was_set_off_here(page):
    page.press(p.JointMoved(ME, 3, 0.4))
    page.press(p.TrajectoryChosen(ME, "climb"))
    page.teleop.add_stop(Stop())
    assert page.run(1.0) == []
    assert page.teleop.trajectory is None


def test_a_refused_target_is_shown_and_not_sent_again(page):
    page.press(p.JointMoved(ME, 0, 9.0))
    page.run(0.1)
    reason = "hyrecro/joints/target: q1 is 9 rad, must be within -1.5708..1.5708 rad"
    key = JOINTS_TARGET.key_expr
    page.teleop.add_event(
        Event(stamp_ns=0, seq=0, frame="", source="sim", severity=Severity.WARNING, text=reason, refused_key=key)
    )
    assert page.run(1.0) == []
    assert page.last_line() == reason


def test_the_log_keeps_the_last_twenty_lines(page):
    for number in range(30):
        page.teleop.add_event(
            Event(stamp_ns=0, seq=number, frame="", source="sim", severity=Severity.INFO, text=str(number))
        )
    assert [line.text for line in page.teleop.lines] == [str(number) for number in range(10, 30)]


def test_one_page_commands_and_the_others_may_only_stop(page):
    page.press(p.Joined(OTHER))
    assert page.press(p.FootChosen(OTHER, Foot.B)) == []
    assert "take control first" in page.last_line()
    assert page.press(p.Stopped(OTHER, "STOP was pressed")) != []
    page.press(p.ControlTaken(OTHER))
    assert page.press(p.FootChosen(ME, Foot.A)) == []
    assert page.press(p.FootChosen(OTHER, Foot.B)) == [LegTarget(foot=Foot.B)]


def test_closing_the_page_that_commands_halts_what_it_has_set_off(page):
    page.press(p.JointMoved(ME, 3, 0.4))
    page.run(0.1)
    assert page.press(p.Left(ME)) == [Stop(text="teleop, the page that commands was closed")]
    assert page.run(1.0) == []


def test_closing_a_page_stops_nobody_else(page):
    page.press(p.Joined(OTHER))
    page.press(p.JointMoved(ME, 3, 0.4))
    assert page.press(p.Left(OTHER)) == [], "it only watched"
    page.run(2.0)
    assert page.press(p.Left(ME)) == [], "nothing was under way"


def test_a_page_that_does_not_answer_halts_what_it_has_set_off(page):
    page.press(p.TrajectoryChosen(ME, "climb"))
    assert page.run(1.9, is_answering=False) == []
    (sent,) = page.run(1.0, is_answering=False)
    assert sent[1] == Stop(text="teleop, the page that commands does not answer")
    assert page.teleop.trajectory is None


def test_after_the_commander_left_the_next_page_commands(page):
    page.press(p.Left(ME))
    page.press(p.Joined(OTHER))
    assert page.press(p.FootChosen(OTHER, Foot.B)) != []


def test_ending_the_process_halts_too(page):
    assert page.teleop.close() == []
    page.press(p.JointMoved(ME, 3, 0.4))
    assert page.teleop.close() == [Stop(text="teleop, the page was ended")]


def test_a_trajectory_runs_until_it_ends_or_is_ended(page):
    page.press(p.TrajectoryChosen(ME, "climb"))
    assert page.teleop.trajectory == "climb"
    page.press(p.JointMoved(ME, 3, 0.4))
    assert page.run(0.5) == []
    assert "a trajectory runs" in page.last_line()
    page.teleop.end_trajectory("trajectory climb: player: line 3: q1 is 9 rad")
    assert page.teleop.trajectory is None
    assert page.last_line() == "trajectory climb: player: line 3: q1 is 9 rad"
    page.press(p.TrajectoryChosen(ME, "climb"))
    assert page.press(p.TrajectoryChosen(ME, None)) == [Stop(text="teleop, the trajectory was ended")]


def test_services_are_known_by_how_long_ago_they_were_heard(page):
    page.teleop.add_health(
        Health(stamp_ns=0, seq=0, frame="", service="sim", uptime_s=1.0, rss_bytes=1, busy_ratio=0.1, channels=())
    )
    page.run(4.0)
    assert page.teleop.heartbeat_ages()["sim"] == pytest.approx(4.0)
