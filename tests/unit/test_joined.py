"""When two joined routers count as split."""

from shared.messaging.joined import SplitWatch


def test_one_that_is_connected_and_no_longer_heard_for_three_looks():
    watch = SplitWatch()
    assert not watch.is_split({"a"}, {"a", "me"})
    assert [watch.is_split({"a"}, {"me"}) for _ in range(4)] == [False, False, True, False]


def test_a_cut_or_one_that_is_heard_again_is_no_split():
    watch = SplitWatch()
    heard = [{"a"}, set(), set(), {"a"}, set(), set()]
    assert not any(watch.is_split({"a"}, those) for those in heard)
    assert not any(watch.is_split(set(), set()) for _ in range(5))


def test_one_that_was_never_heard_is_left_alone():
    watch = SplitWatch()
    assert not any(watch.is_split({"zenohd"}, {"me"}) for _ in range(5))
