from shared.messaging.messages import Clock, Event, Foot, LegTarget, Severity
from shared.runtime.health import Traffic


def clock(seq, stamp_ns=0):
    return Clock(stamp_ns=stamp_ns, seq=seq, frame="")


def event(source, seq):
    return Event(stamp_ns=0, seq=seq, frame="", source=source, severity=Severity.INFO, text="")


def counts(traffic, dropped=None, lost=None, waiting=None):
    return {count.key: count for count in traffic.snapshot(dropped or {}, lost or {}, waiting or {})}


def test_what_was_missed_on_the_way_is_told_from_what_was_dropped_here():
    traffic = Traffic()
    for seq in (0, 1, 5, 6):
        traffic.received("k", clock(seq))
    count = counts(traffic, {"k": 2})["k"]
    assert (count.num_received, count.num_missed, count.num_dropped, count.last_seq) == (4, 1, 2, 6)


def test_what_came_and_was_lost_then_counts_as_dropped():
    traffic = Traffic()
    for seq in (0, 1, 5):
        traffic.received("k", clock(seq))
    count = counts(traffic, {"k": 2}, {"k": 1})["k"]
    assert (count.num_received, count.num_missed, count.num_dropped) == (3, 1, 3)


def test_each_source_of_a_shared_key_counts_for_itself():
    traffic = Traffic()
    for message in (event("sim", 0), event("mapper", 0), event("sim", 1), event("mapper", 3)):
        traffic.received("events", message)
    assert counts(traffic)["events"].num_missed == 2


def test_sent_refused_and_commands():
    traffic = Traffic()
    traffic.sent("a", seq=7, stamp_ns=50)
    traffic.sent("c", seq=None, stamp_ns=None)
    traffic.received("b", LegTarget(foot=Foot.A))
    traffic.refused("b")
    assert (counts(traffic)["a"].num_sent, counts(traffic)["a"].last_seq) == (1, 7)
    assert (counts(traffic)["b"].num_received, counts(traffic)["b"].num_refused) == (1, 1)
    assert traffic.stamp_ns == 50


def test_a_replayed_message_is_known_if_it_or_a_later_one_came():
    traffic = Traffic()
    assert not traffic.is_known("k", clock(3), is_replay=True)
    traffic.received("k", clock(3))
    assert traffic.is_known("k", clock(3), is_replay=True)
    assert traffic.is_known("k", clock(2), is_replay=True)
    assert not traffic.is_known("k", clock(4), is_replay=True)


def test_what_comes_by_itself_after_it_was_asked_for_is_known_once():
    traffic = Traffic()
    assert not traffic.is_known("k", clock(3), is_replay=True)
    assert traffic.is_known("k", clock(3), is_replay=False)
    assert not traffic.is_known("k", clock(3), is_replay=False), "the publisher was started again"
    assert not traffic.is_known("k", clock(7), is_replay=True)
    assert not traffic.is_known("k", clock(8), is_replay=False)


def test_what_an_answer_has_overtaken_is_known_and_so_is_the_answer_when_it_comes_by_itself():
    traffic = Traffic()
    assert not traffic.is_known("k", clock(2, 20), is_replay=True)
    said = [traffic.is_known("k", clock(seq, 10 * seq), is_replay=False) for seq in (0, 1, 2, 3)]
    assert said == [True, True, True, False]
    assert not traffic.is_known("k", clock(1, 10), is_replay=False), "once it has come, numbers are as they are"


def test_a_publisher_that_was_started_again_is_not_overtaken():
    traffic = Traffic()
    assert not traffic.is_known("k", clock(7, 70), is_replay=True)
    assert not traffic.is_known("k", clock(0, 80), is_replay=False)


def test_a_key_of_which_all_was_dropped_is_in_the_snapshot():
    assert counts(Traffic(), {"k": 9})["k"].num_dropped == 9


def test_another_robot_s_stamps_are_not_our_time():
    traffic = Traffic()
    traffic.received("k", clock(0, stamp_ns=5))
    traffic.received("robot_b/k", clock(0, stamp_ns=99), tells_time=False)
    assert traffic.stamp_ns == 5
    assert counts(traffic)["robot_b/k"].num_received == 1


def test_how_long_messages_waited_is_told_once():
    traffic = Traffic()
    for wait_s in (0.5, 0.1, 0.2):
        traffic.waited("k", wait_s)
    count = counts(traffic)["k"]
    assert (count.wait_median_s, count.wait_max_s) == (0.2, 0.5)
    assert counts(traffic)["k"].wait_max_s is None


def test_what_waits_is_in_the_snapshot_though_nothing_was_handled():
    (count,) = Traffic().snapshot({}, {}, {"k": 3})
    assert (count.key, count.num_waiting, count.num_received) == ("k", 3, 0)


def test_bytes_are_counted_by_key():
    traffic = Traffic()
    for num_bytes in (100, 50):
        traffic.sent("a", seq=0, stamp_ns=0, num_bytes=num_bytes)
    traffic.sent("b", seq=0, stamp_ns=0)
    assert (counts(traffic)["a"].num_bytes_sent, counts(traffic)["b"].num_bytes_sent) == (150, 0)
