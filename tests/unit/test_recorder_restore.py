"""A recorder that was killed goes on with its run in the next file, and what is missing between them is counted."""

import json

import pytest
from typer.testing import CliRunner

from cli.bag_commands import app
from services.recorder.bag.balance import balance_of
from services.recorder.recorder import Recorder
from services.recorder.state import RecorderState
from services.recorder.tally import COMPLETE, INCOMPLETE
from shared.errors import InputFileError
from shared.messaging import channels as c, messages as m
from shared.messaging.codec import decode, encode
from shared.runtime.config import RecorderConfig
from tests.support.examples import EXAMPLES
from tests.support.processes import wait_until
from tests.unit.test_recorder import STOP, clock, events, started

(URDF,) = (example for example in EXAMPLES if isinstance(example, m.RobotDescription))


def heartbeat(seq, last_seq):
    count = m.ChannelCount(
        key=c.CLOCK.key_expr,
        num_sent=last_seq + 1,
        num_received=0,
        num_missed=0,
        num_dropped=0,
        num_refused=0,
        last_seq=last_seq,
    )
    return m.Health(
        stamp_ns=last_seq * 10**9,
        seq=seq,
        frame="",
        service="sim",
        uptime_s=1.0,
        rss_bytes=1,
        busy_ratio=0.0,
        channels=(count,),
    )


def killed(recorder, num_written):
    """What a dead recorder leaves: its whole chunks. Its state, as it stands in its file."""
    wait_until(lambda: recorder._run.records({})[0].num_written >= num_written, "written", 5.0)
    return decode(RecorderState, encode(recorder.snapshot()))


def restarted(directory, state, **settings):
    settings = {"run": "here", "min_free_mib": 0, **settings}
    recorder = Recorder(RecorderConfig(directory=directory, **settings), {"seed": "1"})
    said = recorder.restore(state)
    recorder.start()
    return recorder, said


@pytest.fixture
def run_of_two(tmp_path):
    """Ten messages a recorder wrote, of 20; the next one hears 25 to 29 and of a thirtieth."""
    first = started(tmp_path, chunk_period_s=0.01)
    first.add(c.ROBOT_DESCRIPTION, URDF)
    for seq in range(10):
        first.add(c.CLOCK, clock(seq))
    state = killed(first, 10)
    second, said = restarted(tmp_path, state)
    assert "goes on with run here in a new file" in events(said)[0][1]
    second.add(c.ROBOT_DESCRIPTION, URDF)
    for seq in range(25, 30):
        second.add(c.CLOCK, clock(seq))
    second.add(c.HEALTH, heartbeat(0, 30))
    second.close()
    return tmp_path / "here"


def test_it_goes_on_in_the_next_file_and_the_loss_between_is_exact(run_of_two):
    assert sorted(path.name for path in run_of_two.iterdir()) == ["run.mcap", "run_001.mcap"]
    balance = balance_of(run_of_two)
    assert [file.state for file in balance.files] == [INCOMPLETE, INCOMPLETE]
    assert balance.state == INCOMPLETE
    topics = {topic.topic: topic for topic in balance.topics}
    assert (topics["/clock"].num_published, topics["/clock"].num_messages, topics["/clock"].num_missing) == (31, 15, 16)
    description = topics["/robot_description"]
    assert (description.num_messages, description.num_repeated, description.num_missing) == (1, 1, 0)
    assert balance.num_missing == 16


def test_files_that_follow_by_size_or_time_miss_nothing(tmp_path):
    recorder = started(tmp_path, max_file_s=4.0)
    recorder.add(c.ROBOT_DESCRIPTION, URDF)
    for seq in range(12):
        recorder.add(c.CLOCK, clock(seq))
    recorder.add(c.SIM_CONTROL, m.SimControl(real_time_factor=1.0))
    recorder.close()
    balance = balance_of(tmp_path / "here")
    assert len(balance.files) == 3
    assert balance.state == COMPLETE
    topics = {topic.topic: (topic.num_messages, topic.num_repeated, topic.num_missing) for topic in balance.topics}
    assert topics["/clock"] == (12, 0, 0)
    assert topics["/robot_description"] == (1, 2, 0)
    assert topics["/sim/control"] == (1, 0, None)


def test_a_publisher_that_begins_afresh_counts_from_zero(tmp_path):
    recorder = started(tmp_path, max_file_s=100.0)
    for seq in (0, 1, 2, 0, 1, 3):
        recorder.add(c.CLOCK, m.Clock(stamp_ns=(seq + 1) * 10**9, seq=seq, frame=""))
    recorder.close()
    (topic,) = balance_of(tmp_path / "here").topics
    assert (topic.num_messages, topic.num_missing) == (6, 1)


@pytest.mark.parametrize("command", ["info", "verify"])
def test_the_commands_take_the_folder_of_a_run(run_of_two, command):
    result = CliRunner().invoke(app, [command, str(run_of_two), "--json"])
    assert result.exit_code == 3
    shown = json.loads(result.stdout)
    assert (shown["state"], shown["missing"], len(shown["files"])) == ("INCOMPLETE", 16, 2)
    for_people = CliRunner().invoke(app, [command, str(run_of_two)])
    assert "16 messages are in none of the files" in for_people.stdout


def test_a_folder_without_a_run_is_told(tmp_path):
    with pytest.raises(InputFileError, match=r"holds no run\.mcap"):
        balance_of(tmp_path)


def test_what_was_stopped_stays_stopped(tmp_path):
    recorder = started(tmp_path)
    recorder.control(m.RecorderControl(action=STOP))
    again, said = restarted(tmp_path, recorder.snapshot())
    assert said == []
    assert not again.tick()[-1].is_recording


def test_a_run_that_was_begun_by_a_command_goes_on(tmp_path):
    first = started(tmp_path, starts=False)
    first.control(m.RecorderControl(action=m.RecorderAction.START, run="mine", channels=("clock",)))
    state = first.snapshot()
    first.close()
    again, _ = restarted(tmp_path, state, starts=False)
    again.close()
    assert [path.name for path in sorted((tmp_path / "mine").iterdir())] == ["run.mcap", "run_001.mcap"]
    assert again.has_lost


def test_the_state_of_another_run_is_refused(tmp_path):
    recorder = started(tmp_path)
    with pytest.raises(ValueError, match=r"recorder\.run was 'here', is 'there'"):
        restarted(tmp_path, recorder.snapshot(), run="there")
    recorder.close()
