"""The bad link of bench.hosts: packets come late, not at all, or in order. Sockets stand in for tun devices."""

import socket
import time

import pytest

from bench.hosts.wire import Quality, Wire


@pytest.fixture
def ends():
    """The two hosts' ends, and the wire between them."""
    pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM) for _ in range(2)]
    for pair in pairs:
        for end in pair:
            end.setblocking(False)
    wire = Wire((pairs[0][1].fileno(), pairs[1][1].fileno()))
    yield pairs[0][0], pairs[1][0], wire, pairs[0][1].fileno()
    for pair in pairs:
        for end in pair:
            end.close()


def sent(ends, num):
    robot, base, wire, device = ends
    for number in range(num):
        robot.send(bytes([number]))
        wire.take(device)
        wire.deliver()
    got = []
    while True:
        try:
            got.append(base.recv(10)[0])
        except BlockingIOError:
            return got


def test_packets_pass_in_order(ends):
    assert sent(ends, 20) == list(range(20))
    assert ends[2].counts() == {"num_carried": 20, "num_bytes": 20}


def test_a_share_is_lost_and_counted(ends):
    ends[2].quality = Quality(loss=0.5)
    got = sent(ends, 100)
    counts = ends[2].counts()
    assert got == sorted(got)
    assert 30 < len(got) < 70
    assert counts["num_lost"] == 100 - len(got)


def test_a_cut_lets_nothing_pass_and_ends(ends):
    ends[2].quality = Quality(is_cut=True)
    assert sent(ends, 5) == []
    ends[2].quality = Quality()
    assert sent(ends, 5) == list(range(5))


def test_packets_come_after_the_delay(ends):
    robot, base, wire, device = ends
    wire.quality = Quality(delay_s=0.05)
    robot.send(b"x")
    before_s = time.monotonic()
    wire.take(device)
    wait_s = wire.deliver()
    assert wait_s is not None
    while wire.deliver() is not None:
        pass
    assert time.monotonic() - before_s >= 0.05
    assert base.recv(10) == b"x"
