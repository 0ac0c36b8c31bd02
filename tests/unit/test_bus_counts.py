import pytest

from services.recorder.bus_counts import BusCounts
from shared.messaging.messages import ChannelCount, Clock, Event, Foot, Health, LegTarget, Severity


def clock(seq):
    return Clock(stamp_ns=0, seq=seq, frame="")


def event(source, seq):
    return Event(stamp_ns=0, seq=seq, frame="", source=source, severity=Severity.INFO, text="")


def health(key, num_sent, last_seq, service="sim"):
    count = ChannelCount(key=key, num_sent=num_sent, last_seq=last_seq)
    return Health(
        stamp_ns=0, seq=0, frame="", service=service, uptime_s=1.0, rss_bytes=0, busy_ratio=0.0, channels=(count,)
    )


def sim_sent(last_seq):
    return health("hyrecro/clock", last_seq + 1, last_seq)


@pytest.fixture
def bus():
    return BusCounts()


def take(bus, *numbers):
    return [bus.received("clock", clock(seq)) for seq in numbers]


def test_gaps_in_the_numbers_are_missed(bus):
    assert take(bus, 3, 4, 7, 8) == [0, 0, 2, 0]
    assert bus.outstanding() == {}


def test_a_publisher_that_starts_again_begins_at_zero(bus):
    assert take(bus, 5, 0, 2, 2) == [0, 0, 1, 2]


def test_what_a_heartbeat_tells_and_has_not_come_is_outstanding(bus):
    take(bus, 0, 1)
    bus.heard(sim_sent(4))
    assert bus.outstanding() == {"clock": 3}
    assert take(bus, 5) == [3]
    assert bus.outstanding() == {}


def test_an_older_heartbeat_tells_nothing_new(bus):
    take(bus, 0, 1, 2)
    bus.heard(sim_sent(1))
    assert bus.outstanding() == {}


@pytest.mark.parametrize("seq", [8, 9])
def test_the_first_message_of_a_running_publisher_may_come_after_the_heartbeat_that_tells_of_it(bus, seq):
    bus.heard(sim_sent(9))
    assert take(bus, seq, 10) == [0, 9 - seq]
    assert bus.outstanding() == {}


def test_what_was_sent_before_anything_was_heard_is_not_counted(bus):
    bus.heard(sim_sent(9))
    assert bus.outstanding() == {}
    assert take(bus, 12) == [2]


def test_what_was_outstanding_is_lost_when_the_publisher_starts_again(bus):
    take(bus, 0)
    bus.heard(sim_sent(3))
    assert take(bus, 0) == [3]
    bus.heard(sim_sent(0))
    assert bus.outstanding() == {}


def test_a_publisher_may_start_again_with_nothing_of_it_coming(bus):
    take(bus, 0)
    bus.heard(sim_sent(5))
    bus.heard(sim_sent(1))
    assert bus.outstanding() == {"clock": 5 + 2}
    assert take(bus, 2) == [7]


def test_services_that_share_a_key_are_counted_apart(bus):
    sent = [("sim", 5), ("mapper", 0), ("sim", 6), ("mapper", 2)]
    assert [bus.received("events", event(source, seq)) for source, seq in sent] == [0, 0, 0, 1]
    bus.heard(health("hyrecro/events", 4, 99, service="mapper"))
    assert bus.outstanding() == {"events": 1}, "what the mapper heard last is not what it sent last"


def test_commands_and_what_a_subscriber_tells_are_left_alone(bus):
    assert bus.received("leg/target", LegTarget(foot=Foot.A)) == 0
    take(bus, 0)
    bus.heard(health("hyrecro/clock", 0, 7, service="mapper"))
    assert bus.outstanding() == {}


def test_what_was_lost_before_a_recording_is_not_its(bus):
    take(bus, 0)
    bus.heard(sim_sent(3))
    bus.settle()
    assert bus.outstanding() == {}
    assert take(bus, 5) == [1]


def test_a_heartbeat_that_overtakes_the_first_message_loses_nothing(bus):
    """As on a thin link, where small messages pass large ones."""
    bus.heard(sim_sent(0))
    bus.heard(sim_sent(2))
    assert take(bus, 0) == [0]
    assert bus.outstanding() == {"clock": 2}
    assert take(bus, 1, 2, 3) == [0, 0, 0]
    assert bus.outstanding() == {}


def test_the_first_heartbeat_that_is_heard_of_a_service_may_be_its_twelfth(bus):
    first = health("hyrecro/health/sim", 12, 11)
    bus.heard(first)
    assert bus.took("health/sim", "", 11) == 0
    assert bus.took("health/sim", "", 12) == 0
    assert bus.outstanding() == {}
