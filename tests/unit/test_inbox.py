import threading

from shared.messaging import inbox as inbox_module
from shared.messaging.channels import CLOCK, LEG_STATE
from shared.messaging.inbox import EVERY_DEPTH, PARCEL_BYTES, Inbox, Parcel


def parcel(channel, number, size=1):
    return Parcel(channel, channel.key_expr, bytes([number % 256]) * size, None, number)


def numbers(inbox):
    taken = []
    while (item := inbox.take(0.0)) is not None:
        taken.append(item.received_ns)
    return taken


def test_order_of_arrival_across_channels():
    inbox = Inbox()
    for number, channel in enumerate([LEG_STATE, CLOCK, LEG_STATE]):
        inbox.put(parcel(channel, number))
    assert numbers(inbox) == [0, 1, 2]


def test_latest_keeps_the_newest_and_counts_the_rest():
    inbox = Inbox()
    for number in range(10):
        inbox.put(parcel(CLOCK, number))
    assert numbers(inbox) == [8, 9]
    assert inbox.num_dropped == {CLOCK.key_expr: 8}


def test_every_is_bounded_and_says_so():
    inbox = Inbox()
    assert all(inbox.put(parcel(LEG_STATE, number)) for number in range(EVERY_DEPTH))
    assert not inbox.put(parcel(LEG_STATE, EVERY_DEPTH))
    assert numbers(inbox) == list(range(EVERY_DEPTH))
    assert inbox.num_dropped == {LEG_STATE.key_expr: 1}


def test_lossless_keeps_all_up_to_its_bytes():
    inbox = Inbox(max_bytes=10 * (10 + PARCEL_BYTES))
    assert all(inbox.put(parcel(CLOCK, number, size=10)) for number in range(10))
    assert not inbox.put(parcel(CLOCK, 10, size=10))
    assert numbers(inbox) == list(range(10))
    assert inbox.put(parcel(CLOCK, 11, size=100 + 9 * PARCEL_BYTES)), "what was taken makes room again"
    assert inbox.num_dropped == {CLOCK.key_expr: 1}


def test_all_that_waits_is_bounded_in_bytes(monkeypatch):
    monkeypatch.setattr(inbox_module, "MAX_BYTES", 100 + 3 * PARCEL_BYTES)
    inbox = Inbox()
    assert inbox.put(parcel(LEG_STATE, 0, size=60))
    assert not inbox.put(parcel(CLOCK, 1, size=41 + 2 * PARCEL_BYTES))
    assert inbox.put(parcel(CLOCK, 2, size=20))
    assert inbox.put(parcel(CLOCK, 3, size=20))
    assert inbox.put(parcel(CLOCK, 4, size=20)), "the oldest of its own makes room"
    assert numbers(inbox) == [0, 3, 4]
    assert inbox.put(parcel(LEG_STATE, 5, size=100 + 2 * PARCEL_BYTES)), "what was taken makes room again"
    assert inbox.num_dropped == {CLOCK.key_expr: 2}


def test_what_waits_is_told_by_key():
    inbox = Inbox()
    for number in range(3):
        inbox.put(parcel(LEG_STATE, number))
    inbox.put(parcel(CLOCK, 3))
    assert inbox.num_waiting() == {LEG_STATE.key_expr: 3, CLOCK.key_expr: 1}
    numbers(inbox)
    assert inbox.num_waiting() == {}


def test_take_wakes_up_for_a_parcel_of_another_thread():
    inbox = Inbox()
    thread = threading.Thread(target=lambda: inbox.put(parcel(CLOCK, 3)))
    thread.start()
    taken = inbox.take(10.0)
    thread.join()
    assert taken is not None
    assert taken.received_ns == 3
