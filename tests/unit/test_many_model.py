"""The model of many robots: what one and two cost says what more cost, if costs are what it takes them for."""

import pytest

from bench.many_model import SLOW, Load, Model, report

STEP_S, SCAN_S, IDLE, HOP_S, MB_S = 0.002, 0.02, 0.01, 20e-6, 0.001


def load(num_robots, kinds=("lidar", "sim"), pace=SLOW):
    """Of robots that cost exactly what the model says: 100 steps, 10 scans of 200 kB a second at pace 0.2."""
    steps_hz, scans_hz = 100.0 * pace / SLOW, 10.0 * pace / SLOW if "lidar" in kinds else 0.0
    routed_hz, routed_mb = num_robots * 2 * (steps_hz + scans_hz), num_robots * 0.4 * scans_hz
    cpu = {"sim": num_robots * steps_hz * STEP_S, "router": IDLE + HOP_S * routed_hz + MB_S * routed_mb}
    if "lidar" in kinds:
        cpu["lidar"] = num_robots * scans_hz * SCAN_S
    return Load(
        num_robots=num_robots,
        real_time_factor=pace,
        kinds=kinds,
        cpu=cpu,
        rate_hz={"tf": steps_hz, **({"lidar/points": scans_hz} if scans_hz else {})},
        bytes_a_message={"tf": 1000, "lidar/points": 200_000},
        routed_hz=routed_hz,
        routed_mb_per_s=routed_mb,
        num_lost=0,
        delay_p50_ms=0.5,
        delay_p99_ms=1.0,
    )


FEW = [load(number, kinds) for number in (1, 2) for kinds in (("sim",), ("lidar", "sim"))]


@pytest.fixture
def model():
    return Model.fitted([*FEW, load(4), load(1, pace=1.0)])


def test_it_finds_the_costs_again(model):
    assert model.work_s == pytest.approx({"sim": STEP_S, "lidar": SCAN_S})
    assert (model.idle, model.hop_s, model.mb_s) == pytest.approx((IDLE, HOP_S, MB_S))


def test_it_foretells_more_robots_than_it_has_seen(model):
    assert model.cpu(8, ("lidar", "sim")) == pytest.approx(load(8).cpu)


def test_it_foretells_robots_that_are_quicker(model):
    assert model.cpu(2, ("lidar", "sim"), 1.0) == pytest.approx(load(2, pace=1.0).cpu)


def test_it_says_where_a_machine_and_a_link_are_full(model):
    # a robot: 0.2 + 0.2 + 220 x 20 us + 4 MB x 1 ms = 0.4084 cores, and 100 kB + 2 MB a second
    text = model.prediction(3, num_cores=4.0, link_mbps=100.0, real_time_factor=SLOW)
    assert text.startswith("3 robots need 1.24 of 4 cores (lidar 0.60, sim 0.60, router 0.04)")
    assert "needs 50.4 of 100 Mbit/s" in text
    assert text.endswith("Up to 80% are used by 7 robots on the machine, 4 on the link.")


def test_the_report_sets_what_was_measured_beside_what_was_foretold(model):
    line = next(line for line in report([*FEW, load(4)]).splitlines() if line.startswith("| 4 "))
    assert "| +0% | 0 | 0.50, 1.00 |" in line


def test_without_measurements_it_says_what_to_do():
    with pytest.raises(ValueError, match=r"run `python -m bench\.many`"):
        Model.fitted([load(4)])
