import dataclasses

from services.recorder.bag.overview import overview_of
from services.recorder.bag.verification import verified
from services.recorder.disk import new_file
from services.recorder.mcap_log import McapLog
from services.recorder.records import to_record
from services.recorder.tally import COUNTS_METADATA, RUN_METADATA
from shared.messaging.channels import CHANNELS, CLOCK
from tests.support.recordings import CLOCK_HZ, NUM_SECONDS, clock, write_recording


def test_a_whole_recording_is_fine(tmp_path):
    verification = verified(write_recording(tmp_path / "run.mcap"))
    assert verification.is_fine
    report = verification.topics["/clock"]
    num = NUM_SECONDS * CLOCK_HZ
    assert (report.num_messages, report.num_expected, report.num_gaps) == (num, num, 0)
    assert (report.first_ns, report.last_ns) == (0, (num - 1) * 10**9 // CLOCK_HZ)


def test_gaps_restarts_stamps_and_unreadable_bytes_are_found(tmp_path):
    log = McapLog(new_file(tmp_path / "run.mcap"), CHANNELS, {RUN_METADATA: {}})
    for message in (clock(0), clock(3), dataclasses.replace(clock(4), stamp_ns=0), clock(0)):
        log.add(to_record(CLOCK, message, message.stamp_ns, number=1))
    record = to_record(CLOCK, clock(1), 0, number=1)
    log.add(dataclasses.replace(record, data=record.data[:3]))
    log.flush()
    log.close()
    verification = verified(tmp_path / "run.mcap")
    report = verification.topics["/clock"]
    found = (report.num_messages, report.num_gaps, report.num_restarts, report.num_backward, report.num_unreadable)
    assert found == (5, 2, 1, 1, 1)
    assert not verification.is_fine
    assert "/clock, message 1: not readable" in report.problems[0]


def test_counts_of_an_earlier_version_are_read(tmp_path):
    log = McapLog(new_file(tmp_path / "run.mcap"), CHANNELS, {RUN_METADATA: {}})
    log.add(to_record(CLOCK, clock(0), 0, number=1))
    log.flush()
    log.close({COUNTS_METADATA: {"/clock": '{"num_received": 1, "num_missed": 4, "num_restarts": 0}'}})
    overview = overview_of(tmp_path / "run.mcap")
    (topic,) = [topic for topic in overview.topics if topic.topic == "/clock"]
    assert (topic.counts.num_received, topic.counts.num_lost, topic.counts.num_published) == (1, 4, None)
    assert (overview.state, overview.problems) == ("INCOMPLETE", ("/clock: 4 messages lost",))
