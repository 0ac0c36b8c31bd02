"""What `hyrecro up` records, as the tools of others see it: rosbags, mcap-ros2-support, the Rerun viewer."""

import re
import signal

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from services.recorder.bag.recording import Recording
from shared.messaging.channels import CHANNELS, HEALTH, LIDAR_POINTS, TF
from shared.runtime.config_loading import load_config
from tests.e2e.conftest import ALL_SERVICES, wait_for_services
from tests.support.processes import hyrecro_command, run, started, wait_until
from tests.support.viewer import viewer

pytestmark = pytest.mark.e2e

ACTUATORS = '{"names": ["th_b"], "positions": [0.1]}'


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    """Some seconds of a pipeline: the robot moves, changes its foot, refuses two targets; stopped by Ctrl-C."""
    with started(hyrecro_command("up", "--set", "mapper.map_rate_hz=5"), tmp_path_factory.mktemp("record")) as running:
        wait_for_services(running, ALL_SERVICES)
        children = running.children()
        assert running.hyrecro("robot", "joints", "-0.3", "0", "0.3", "0", "0", "0.3", "0", "-0.3").returncode == 0
        wait_until(lambda: running.state()["stamp_s"] > 3, "three seconds of simulated time")
        assert running.hyrecro("robot", "leg", "B").returncode == 0
        assert running.hyrecro("sim", "speed", "1").returncode == 0
        assert running.zenoh("put", "-k", "hyrecro/actuators/target", "-v", ACTUATORS).returncode == 0
        assert running.zenoh("put", "-k", "hyrecro/replay/control", "-v", '{"action": "pause"}').returncode == 0
        assert running.hyrecro("robot", "stop").returncode == 0
        assert running.hyrecro("record", "start").returncode == 1
        in_the_air = ("--point", "0", "0", "20", "--normal", "0", "0", "1")
        assert running.hyrecro("robot", "step", *in_the_air).returncode == 1
        assert running.hyrecro("robot", "joints", "9", "0", "0", "0", "0", "0", "0", "0").returncode == 1
        wait_until(lambda: running.state()["stamp_s"] > 5, "five seconds of simulated time")
        assert running.stop(signal.SIGINT) == 130
        assert [child for child in children if child.is_running()] == []
    return running.directory / "latest"


def test_the_file_is_complete_and_holds_every_channel(run_folder):
    recording = Recording(run_folder / "run.mcap")
    counts = {topic.topic: topic for topic in recording.topics()}
    health = {HEALTH.of(name).topic for name in (*ALL_SERVICES, "supervisor")}
    assert (
        set(counts) == {channel.topic for channel in CHANNELS if channel.is_recorded and channel is not HEALTH} | health
    )
    assert [name for name, topic in counts.items() if topic.num_messages == 0] == []
    assert {name: topic.num_missed for name, topic in counts.items() if topic.num_missed} == {}


def test_it_holds_everything_from_the_first_message_on(run_folder):
    recording = Recording(run_folder / "run.mcap")
    for channel in (TF, LIDAR_POINTS):
        numbers = [message.seq for message in recording.messages(channel)]
        assert numbers == list(range(len(numbers)))


def test_it_says_how_it_was_made(run_folder, tmp_path):
    metadata = Recording(run_folder / "run.mcap").metadata
    assert metadata["seed"] == "1"
    assert re.fullmatch(r"\d+\.\d+\.\d+", metadata["version"])
    (tmp_path / "resolved.yaml").write_text(metadata["config"])
    assert load_config(tmp_path / "resolved.yaml").mapper.map_rate_hz == 5


def test_rosbags_decodes_every_message(run_folder):
    with AnyReader([run_folder / "run.mcap"]) as reader:
        topics = set()
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            topics.add(connection.topic)
    assert {"/lidar/points", "/tf", "/joints/state", "/map/cloud", "/map/odometry", "/robot_description"} <= topics


def test_mcap_ros2_decodes_every_message(run_folder):
    with (run_folder / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = {channel.topic: message for _, channel, _, message in reader.iter_decoded_messages()}
    scan = decoded["/lidar/points"]
    assert [field.name for field in scan.fields] == ["x", "y", "z", "intensity", "t", "ring"]
    assert scan.header.frame_id == "lidar"
    assert decoded["/leg/state"].fixed_foot == "B"
    assert "q1" in decoded["/events"].msg


def test_rerun_reads_it_as_a_whole(run_folder):
    info = run("rerun", "mcap", "info", run_folder / "run.mcap")
    assert info.returncode == 0
    for topic in ("/lidar/points", "/tf", "/joints/state", "/map/cloud", "/map/odometry", "/robot_description"):
        assert topic in info.stdout
    assert run("rerun", "mcap", "check", run_folder / "run.mcap").returncode == 0


def test_bare_rerun_draws_it_without_a_layout(run_folder):
    recording = Recording(run_folder / "run.mcap")
    with viewer(run_folder / "run.mcap") as client:
        state = client.get_state()
        assert {"2D", "3D", "TextLog", "TimeSeries"} <= {view.view_class for view in state.views}
        recording_id = state.recordings[0].store_id
        for share in (0.1, 0.5, 0.99):
            stamp_s = share * recording.duration_s
            client.set_time("message_log_time", timestamp=stamp_s, play_state="paused", recording=recording_id)
            client.take_screenshot()
            assert [report.summary for view in client.get_state().views for report in view.reports] == []
        entities = client.get_recording_schema(recording_id).entities
    archetypes = {entity.entity_path: {component.archetype for component in entity.components} for entity in entities}
    for path, archetype in DRAWN.items():
        assert f"rerun.archetypes.{archetype}" in archetypes[path], path


DRAWN = {
    "/hyrecro/visual_geometries/hip/visual_0": "Boxes3D",
    "/fixed_foot/visual_geometries/fixed_foot/visual_0": "Boxes3D",
    "/lidar/points": "Points3D",
    "/map/cloud": "Points3D",
    "/depth/image": "DepthImage",
    "/joints/state/position": "Scalars",
}


def test_what_was_published_is_what_was_recorded(run_folder):
    recording = Recording(run_folder / "run.mcap")
    health = {message.service: message for message in recording.messages(HEALTH)}
    sent = {count.key: count.num_sent for count in health["sim"].channels}
    assert sent[TF.key_expr] == sum(1 for _ in recording.messages(TF))
