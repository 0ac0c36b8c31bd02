"""The profile `secure` of docker-compose.yml: the same line, each container with its own credential, none with more."""

import pytest
from ruamel.yaml import YAML

from shared.messaging.credentials import SECURE_ROUTER
from shared.runtime.roles import ROLES
from tests.support.processes import ROOT


def read(name):
    yaml = YAML(typ="rt")  # keeps the tags by which a service replaces what it extends
    return yaml.load(ROOT / name)


OPEN, SECURE = read("docker-compose.yml")["services"], read("docker-compose.secure.yml")["services"]
LINE = {name: service for name, service in OPEN.items() if "open" in service["profiles"]}
OWN = sorted(set(LINE) - {"router"})


@pytest.mark.parametrize("name", OPEN)
def test_no_container_may_more_than_it_needs(name):
    service = OPEN[name]
    assert service["user"] == "10001:10001"
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["pids_limit"]
    assert ":" in service["image"] or "build" in service


def test_a_profile_takes_the_place_of_the_open_line():
    assert (ROOT / ".env").read_text().splitlines()[-1] == "COMPOSE_PROFILES=open"
    assert {name for name, service in OPEN.items() if "open" not in service["profiles"]} == {"player", "teleop"}
    assert all(list(service.get("profiles", ["secure"])) == ["secure"] for service in SECURE.values())


def test_it_has_the_same_services():
    assert set(SECURE) == {"certs", *(f"secure-{name}" for name in LINE)}
    for name in LINE:
        assert dict(SECURE[f"secure-{name}"]["extends"]) == {"file": "docker-compose.yml", "service": name}


@pytest.mark.parametrize("name", OWN)
def test_a_service_sees_its_own_credential_alone(name):
    assert name in ROLES
    service = SECURE[f"secure-{name}"]
    assert service["environment"]["HYRECRO_BUS__CREDENTIALS"] == f"/credentials/{name}.json5"
    assert service["environment"]["HYRECRO_BUS__ENDPOINT"] == "tls/router:7447"
    (volume,) = service["volumes"]
    assert (volume["target"], volume["volume"]["subpath"]) == (f"/credentials/{name}.json5", f"{name}.json5")
    assert volume["read_only"] is True


def test_the_router_finds_its_files_where_its_configuration_says():
    volumes = SECURE["secure-router"]["volumes"]
    assert volumes[0] == f"./{SECURE_ROUTER.relative_to(ROOT)}:/etc/zenoh/router.json5:ro"
    assert volumes[1]["target"] == "/credentials/router"
    text = SECURE_ROUTER.read_text()
    assert all(f'"/credentials/router/{name}"' in text for name in ("ca.pem", "router.pem", "router.key", "passwords"))
