import pytest

from bench.slow_subscriber import rows_of, table
from bench.soak import Machine, Sample, growths, tables


def figures(latency_ms, num_missed=0):
    return {"joints/state": {"latency_ms": latency_ms, "num_missed": num_missed}}


def test_rows_tell_each_kind_beside_the_run_without():
    rounds = [{"none": figures([1.0] * 10), "link": figures([2.0] * 10, 3)} for _ in range(3)]
    rounds[2]["link"] = figures([5.0] * 10)
    none, link = rows_of(rounds)
    assert (none.p99_ratio, none.num_received, none.num_missed) == (1.0, 30, 0)
    assert (link.p99_ratio, link.p99_least_ms, link.p99_most_ms, link.num_missed) == (2.0, 2.0, 5.0, 6)
    assert len(table([none, link]).splitlines()) == 4


def sample(name, time_s, rss_mb, num_open_files=20):
    return Sample(
        time_s=time_s,
        name=name,
        rss_mb=rss_mb,
        shared_mb=0.0,
        num_open_files=num_open_files,
        num_threads=9,
        cpu_ratio=0.1,
    )


def test_growth_is_that_after_the_warm_up():
    times_s = range(0, 3600, 10)
    samples = [sample("sim", time_s, 100.0 if time_s >= 720 else 50.0) for time_s in times_s]
    samples += [sample("mapper", time_s, 100.0 + time_s / 360, 20 + time_s // 1000) for time_s in times_s]
    sim, mapper = growths(samples, 60)
    assert (sim.rss_growth, sim.num_open_files) == (pytest.approx(0), (20, 20))
    assert mapper.rss_growth == pytest.approx((3590 - 720) / 360 / (100 + (3590 + 720) / 2 / 360))
    assert mapper.num_open_files == (20, 23)


def test_too_short_a_run_says_so():
    with pytest.raises(ValueError, match=r"4 minutes are too few: the warm-up alone takes 3\.3"):
        growths([sample("sim", 10.0 * i, 1.0) for i in range(24)], 4)


def test_the_table_has_processes_and_the_machine():
    machine = [
        Machine(time_s=10.0 * i, bus_memory_mb=90.0, delay_p50_ms={"tf": 1.0}, delay_p99_ms={"tf": 5.0})
        for i in range(360)
    ]
    text = tables(growths([sample("sim", 10.0 * i, 100.0) for i in range(360)], 60), machine, 60)
    assert "| sim | 100.0 | 100.0 | +0.00 % | 20 -> 20 | 9 -> 9 |" in text.replace("-0.00", "+0.00")
    assert "| shared memory of the bus, MB | 90.0 | 90.0 |" in text
    assert "| tf, p99 of the delay, ms | 5.0 | 5.0 |" in text
