"""Each service as a process of its own: what is wrong is said in one line, with the right exit code."""

import signal
import sys

import pytest

from tests.e2e.conftest import wait_for_services
from tests.support.processes import ROOT, free_endpoint, hyrecro_command, run, service_command, started, wait_until

pytestmark = pytest.mark.e2e

MODULES = ["sim", "sensors", "mapper", "recorder", "evaluator", "player"]


@pytest.mark.parametrize("name", MODULES)
def test_without_a_router(name, tmp_path):
    endpoint = free_endpoint()
    settings = [f"bus.endpoint={endpoint}", "bus.connect_timeout_s=0.3", f"recorder.directory={tmp_path}"]
    options = [part for setting in settings for part in ("--set", setting)]
    result = run(sys.executable, "-m", f"services.{name}", "--config", "configs/default.yaml", *options)
    assert result.returncode == 1
    assert f"no router at {endpoint} after 0.3 s" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("name", MODULES)
def test_with_a_wrong_configuration(name, tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text("mapper: {voxel_sise_m: 1}\nsim: {rate_hz: 0}\nrobot: nowhere.urdf\n")
    result = run(sys.executable, "-m", f"services.{name}", "--config", path)
    assert result.returncode == 2
    for part in ("voxel_size_m?", "sim.rate_hz: should be greater", "robot: no such file: nowhere.urdf"):
        assert part in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("content", ["", "<robot", "<robot name='r'/>", "\x00"])
def test_a_robot_that_is_no_urdf(content, tmp_path):
    path = tmp_path / "bad.urdf"
    path.write_text(content)
    result = run(sys.executable, "-m", "services.sim", "--set", f"robot={path}")
    assert result.returncode == 2
    assert str(path) in result.stderr
    assert "Traceback" not in result.stderr


def test_a_sensor_that_cannot_be_mounted():
    sensor = "sensors.others.lidar_rear={kind: lidar, frame: lidar_rear}"
    result = run(sys.executable, "-m", "services.sim", "--set", sensor)
    assert result.returncode == 2
    assert "sensors.others.lidar_rear.frame: " in result.stderr
    assert "has no link 'lidar_rear'" in result.stderr
    assert "Traceback" not in result.stderr


def test_wrong_arguments():
    assert run(sys.executable, "-m", "services.sim", "--speed", "9").returncode == 2
    assert run(sys.executable, "-m", "services.sensors", "--sensor", "sonar").returncode == 2
    assert run("hyrecro", "fly").returncode == 2
    assert run("hyrecro", "config", "check", "--config", "nowhere.yaml").returncode == 2


def test_help_needs_no_heavy_imports():
    heavy = ("numpy", "open3d", "zenoh", "pydantic", "pybullet")
    code = f"import sys, cli.main; print([name for name in {heavy} if name in sys.modules])"
    assert run(sys.executable, "-c", code).stdout == "[]\n"
    help_ = run("hyrecro", "--help")
    assert help_.returncode == 0
    for verb in ("up", "demo", "simulate", "router", "doctor", "robot", "sim", "config", "structure"):
        assert verb in help_.stdout


def test_doctor_and_config():
    doctor = run("hyrecro", "doctor")
    assert doctor.returncode == 0, doctor.stdout
    shown = run("hyrecro", "config", "show", "--set", "seed=7")
    assert "seed: 7\n" in shown.stdout


@pytest.mark.parametrize(("signum", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_a_service_waits_for_the_router_and_ends_on_a_signal(tmp_path, signum, code):
    endpoint = free_endpoint()
    with (
        started(service_command("services.evaluator"), tmp_path / "service", endpoint) as service,
        started(hyrecro_command("router"), tmp_path / "router", endpoint),
    ):
        wait_for_services(service, {"evaluator"})
        assert service.stop(signum) == code


def test_a_second_pipeline_at_the_same_place_is_refused(tmp_path):
    with started(hyrecro_command("router"), tmp_path / "router") as router:
        wait_until(lambda: router.hyrecro("doctor", "--alive", "x").stdout, "the router")
        second = run("hyrecro", "up", "--set", f"bus.endpoint={router.endpoint}", cwd=ROOT)
        assert second.returncode == 1
        assert "is taken" in second.stderr
