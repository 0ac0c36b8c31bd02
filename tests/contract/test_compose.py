"""docker-compose.yml: what it starts exists, and it listens to nobody but this machine."""

import importlib.util
import os
from importlib.metadata import version
from typing import get_args

import pytest
import zenoh
from ruamel.yaml import YAML

from cli.options import Part
from cli.pipeline import services_of
from shared.messaging.queues import ROUTER_RUNTIME, queues_of_router
from shared.runtime.config_loading import load_config
from tests.support.processes import ROOT, run

SERVICES = {name: command for group in services_of(load_config()) for name, command in group.items()}
COMPOSE = YAML(typ="safe").load(ROOT / "docker-compose.yml")
OWN = {name: service for name, service in COMPOSE["services"].items() if service["image"] == "hyrecro"}
READY_FILE = COMPOSE["x-service"]["tmpfs"][0] + "/ready"
CHECK = f"find {READY_FILE} -newermt '-5 seconds' | grep -q ."


@pytest.mark.parametrize("name", OWN)
def test_each_command_names_a_service_that_exists(name):
    module, *arguments = OWN[name]["command"]
    assert importlib.util.find_spec(f"{module}.__main__") is not None
    flags, values = arguments[::2], arguments[1::2]
    assert set(flags) <= {"--sensor", "--set"}
    assert [value for flag, value in zip(flags, values, strict=True) if flag == "--sensor" and value != name] == []
    load_config(overrides=[value for flag, value in zip(flags, values, strict=True) if flag == "--set"])


def test_it_starts_what_the_launcher_starts():
    assert {name: OWN[name]["command"] for name in SERVICES} == SERVICES
    assert set(OWN) - set(SERVICES) == {"player", "teleop"}
    assert all(OWN[name]["profiles"] for name in ("player", "teleop"))


@pytest.mark.parametrize("name", SERVICES)
def test_each_service_is_watched_and_restarted(name):
    assert OWN[name]["restart"] == "on-failure"


@pytest.mark.parametrize("name", OWN)
def test_health_is_what_the_guard_says(name):
    expected = {"disable": True} if name == "player" else {"test": ["CMD-SHELL", CHECK]}
    assert OWN[name]["healthcheck"].items() >= expected.items()


def test_on_the_secure_bus_health_is_the_same():
    services = YAML().load(ROOT / "docker-compose.secure.yml")["services"]
    own_checks = {name for name, service in services.items() if "healthcheck" in service}
    assert own_checks == {"certs"}, "which ends and has none"
    assert {service["extends"]["service"] for service in services.values()} == {*SERVICES, "router"}


def test_a_check_believes_the_guards_file_while_it_is_new(tmp_path):
    path = tmp_path / "ready"
    check = ("sh", "-c", CHECK.replace(READY_FILE, str(path)))
    assert run(*check).returncode == 1, "the service is not ready"
    path.touch()
    assert run(*check).returncode == 0
    os.utime(path, (0, 0))
    assert run(*check).returncode == 1, "the guard is frozen"


def test_a_guard_keeps_each_service_running_but_no_climb_begins_again():
    dockerfile = (ROOT / "Dockerfile").read_text()
    assert f'ENTRYPOINT ["python", "-m", "shared.runtime.guard", "{READY_FILE}"]' in dockerfile
    assert {name for name, service in OWN.items() if "entrypoint" in service} == {"player"}
    assert OWN["player"]["entrypoint"] == ["python", "-m"]


def test_the_router_has_the_clients_version_and_listens_on_loopback():
    router = COMPOSE["services"]["router"]
    assert router["image"] == f"eclipse/zenoh:{version('eclipse-zenoh')}"
    assert router["ports"] == ["127.0.0.1:7447:7447"]
    assert router["shm_size"]
    ports = {name: service["ports"] for name, service in COMPOSE["services"].items() if service.get("ports")}
    assert set(ports) == {"router", "teleop"}
    assert all(port.startswith("127.0.0.1:") for published in ports.values() for port in published)


def test_the_routers_file_sets_what_the_embedded_router_sets():
    queue = "transport/link/tx/queue"
    router = zenoh.Config.from_file(ROOT / "configs" / "zenoh" / "router.json5")
    embedded = zenoh.Config()
    for path, number in queues_of_router().items():
        embedded.insert_json5(path, str(number))
    assert router.get_json(queue) == embedded.get_json(queue)
    assert router.get_json("transport/shared_memory/transport_optimization/enabled") == "false"
    assert router.get_json("scouting/multicast/enabled") == "false"
    assert router.get_json("mode") == '"router"'
    assert COMPOSE["services"]["router"]["environment"] == {"ZENOH_RUNTIME": ROUTER_RUNTIME}


def test_over_several_hosts_each_service_is_on_one_of_them():
    hosts = YAML().load(ROOT / "docker-compose.hosts.yml")["services"]
    profiles = {name: service["profiles"] for name, service in hosts.items() if "profiles" in service}
    assert {those.tag.value for those in profiles.values()} == {"!override"}, "or the page's profile starts them, too"
    assert profiles.pop("router") == ["robot", "base"]
    assert set(profiles) == set(SERVICES)
    for part in get_args(Part):
        of_up = {name for group in services_of(load_config(), part) for name in group}
        assert {name for name, those in profiles.items() if those == [part]} == of_up, "as in `hyrecro up --part`"
    assert hosts["router"]["command"].startswith("cli.main router "), "which joins again where Zenoh's own does not"
    assert hosts["router"]["healthcheck"]["test"] == COMPOSE["services"]["sim"]["healthcheck"]["test"]
    assert list(hosts["router"]["ports"]) == ["${HYRECRO_LISTEN:-127.0.0.1}:7447:7447"], (
        "loopback unless told otherwise"
    )
