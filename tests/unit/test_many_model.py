"""The model of many robots: what one and two cost says what more cost, if costs are what it takes them for."""

import pytest

from bench.many_model import Load, Model, report

STEP_S, SCAN_S, HOP_S, MB_S = 0.002, 0.02, 20e-6, 0.001


def load(num_robots, kinds=("lidar", "sim")):
    """Of robots that cost exactly what the model says: 100 steps, 10 scans of 200 kB a second."""
    scans_hz = 10.0 if "lidar" in kinds else 0.0
    routed_hz, routed_mb = num_robots * (200 + 2 * scans_hz), num_robots * 0.4 * scans_hz
    cpu = {"sim": num_robots * 100 * STEP_S, "router": HOP_S * routed_hz + MB_S * routed_mb}
    if "lidar" in kinds:
        cpu["lidar"] = num_robots * scans_hz * SCAN_S
    return Load(
        num_robots=num_robots,
        kinds=kinds,
        cpu=cpu,
        rate_hz={"tf": 100.0, **({"lidar/points": scans_hz} if scans_hz else {})},
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
    return Model.fitted([*FEW, load(4)])


def test_it_finds_the_costs_again(model):
    assert model.work_s == pytest.approx({"sim": STEP_S, "lidar": SCAN_S})
    assert (model.hop_s, model.mb_s) == pytest.approx((HOP_S, MB_S))


def test_it_foretells_more_robots_than_it_has_seen(model):
    assert model.cpu(8, ("lidar", "sim"), FEW[1]) == pytest.approx(load(8).cpu)


def test_it_says_where_a_machine_and_a_link_are_full(model):
    # a robot: 0.2 + 0.2 + 220 x 20 us + 4 MB x 1 ms = 0.4084 cores, and 100 kB + 2 MB a second
    text = model.prediction(3, num_cores=4.0, link_mbps=100.0)
    assert text.startswith("3 robots need 1.23 of 4 cores (lidar 0.60, sim 0.60, router 0.03)")
    assert "needs 50.4 of 100 Mbit/s" in text
    assert text.endswith("Up to 80% are used by 7 robots on the machine, 4 on the link.")


def test_the_report_sets_what_was_measured_beside_what_was_foretold(model):
    line = next(line for line in report([*FEW, load(4)]).splitlines() if line.startswith("| 4 "))
    assert "| +0% | 0 | 0.50, 1.00 |" in line


def test_without_measurements_it_says_what_to_do():
    with pytest.raises(ValueError, match=r"run `python -m bench\.many`"):
        Model.fitted([load(4)])
