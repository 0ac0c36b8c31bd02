import pytest
from rich.console import Console

from cli.top import Top
from cli.top_table import tables
from shared.messaging.messages import ChannelCount, Health

SCANS, JOINTS = "hyrecro/lidar/points", "hyrecro/joints/state"


def heartbeat(service, uptime_s, *channels, **figures):
    fields = {"rss_bytes": 50_000_000, "busy_ratio": 0.25, "cpu_ratio": 0.5} | figures
    return Health(stamp_ns=0, seq=0, frame="", service=service, uptime_s=uptime_s, channels=channels, **fields)


def sent(num, num_bytes=0):
    return ChannelCount(key=SCANS, num_sent=num, num_bytes_sent=num_bytes, last_seq=num - 1)


def pipeline():
    """A sensor that sends ten scans of 1 kB a second, and a mapper that is too slow for them."""
    top = Top()
    top.set_alive({"lidar", "mapper"})
    top.add(heartbeat("lidar", 1.0, sent(10, 10_000)), 10.0)
    top.add(heartbeat("lidar", 3.0, sent(30, 30_000)), 12.0)
    top.add(heartbeat("mapper", 1.0, ChannelCount(key=SCANS, num_received=4)), 10.0)
    slow = {"num_dropped": 5, "num_missed": 1, "num_waiting": 2, "wait_median_s": 0.1, "wait_max_s": 0.2}
    top.add(heartbeat("mapper", 2.0, ChannelCount(key=SCANS, num_received=8, **slow)), 11.0)
    return top


def rows(top, now_s=12.0):
    return {row.name: row for row in top.services(now_s)}


def text(top, now_s=12.0, width=80):
    console = Console(width=width)
    with console.capture() as capture:
        console.print(tables("title", top.services(now_s), top.channels()))
    return capture.get()


def test_rates_are_of_the_services_own_clock():
    assert (rows(pipeline())["lidar"].sent_hz, rows(pipeline())["mapper"].received_hz) == (10.0, 4.0)


def test_a_channel_tells_rate_bytes_and_how_each_subscriber_fares():
    (channel,) = pipeline().channels()
    assert (channel.key, channel.rate_hz, channel.bytes_per_s) == ("lidar/points", 10.0, 10_000.0)
    assert channel.publishers == ("lidar",)
    (hearer,) = channel.hearers
    assert (hearer.service, hearer.wait_max_s, hearer.num_dropped, hearer.num_missed) == ("mapper", 0.2, 5, 1)


def test_one_heartbeat_tells_no_rates():
    top = Top()
    top.set_alive({"lidar"})
    top.add(heartbeat("lidar", 1.0, sent(10)), 10.0)
    assert not top.is_complete
    assert (rows(top)["lidar"].sent_hz, top.channels()[0].rate_hz) == (None, None)
    top.add(heartbeat("lidar", 2.0, sent(20)), 11.0)
    assert top.is_complete


@pytest.mark.parametrize(
    ("alive", "now_s", "state"),
    [({"sim"}, 11.9, "ready"), ({"sim"}, 12.1, "silent"), (set(), 11.9, "starting"), (set(), 12.1, "gone")],
)
def test_states(alive, now_s, state):
    top = Top()
    top.add(heartbeat("sim", 1.0), 10.0)
    top.set_alive(alive)
    assert rows(top, now_s)["sim"].state == state


def test_who_holds_its_token_and_was_never_heard_is_silent():
    top = Top()
    top.set_alive({"sim"})
    (row,) = top.services(0.0)
    assert (row.state, row.rss_bytes, row.received_hz) == ("silent", None, None)
    assert "silent" in text(top)


def test_a_restart_is_seen_by_the_uptime_and_begins_new_rates():
    top = pipeline()
    top.add(heartbeat("lidar", 0.5, sent(5)), 13.0)
    row = rows(top, 13.0)["lidar"]
    assert (row.num_restarts, row.sent_hz) == (1, None)
    top.add(heartbeat("lidar", 1.5, sent(15)), 14.0)
    assert (rows(top, 14.0)["lidar"].num_restarts, rows(top, 14.0)["lidar"].sent_hz) == (1, 10.0)


def test_channels_are_those_of_living_services():
    top = pipeline()
    top.set_alive({"mapper"})
    (channel,) = top.channels()
    assert (channel.publishers, channel.rate_hz) == ((), None)


def test_the_tables_fit_into_eighty_columns_and_lose_nothing():
    top = pipeline()
    names = ("evaluator", "recorder", "planner", "depth_front")
    for name in names:
        top.add(heartbeat(name, 5000.0, ChannelCount(key=JOINTS, num_received=10**6), rss_bytes=10**9), 12.0)
    top.set_alive({"lidar", "mapper", *names})
    lines = text(top, now_s=20.0).splitlines()
    assert max(map(len, lines)) <= 80
    assert not any("…" in line for line in lines)
    (line,) = [line for line in lines if line.startswith("lidar/points")]
    assert line.split() == ["lidar/points", "10.0", "10", "lidar", "mapper", "200", "5", "drop", "1", "lost"]
    (line,) = [line for line in lines if line.startswith("mapper")]
    assert line.split()[:3] == ["mapper", "silent", "9s"]
