"""Which credential a process shows, and what it says of a setting that leads to none."""

import pytest

from shared.errors import ConfigError
from shared.messaging.credentials import credential_of, router_settings
from shared.runtime.config import BusConfig
from shared.runtime.config_loading import load_config
from shared.runtime.roles import role_of


def secure(path):
    return BusConfig(endpoint="tls/127.0.0.1:7447", credentials=path)


@pytest.mark.parametrize(("name", "role"), [("sim", "sim"), ("lidar", "lidar"), ("lidar_rear", "lidar")])
def test_a_service_takes_its_own_file_of_a_folder(tmp_path, name, role):
    assert role_of(name) == role
    (tmp_path / f"{role}.json5").touch()
    assert credential_of(secure(tmp_path), name) == tmp_path / f"{role}.json5"


def test_a_file_is_everyones(tmp_path):
    path = tmp_path / "operator.json5"
    path.touch()
    assert credential_of(secure(path), "player") == path


def test_an_open_bus_asks_for_none():
    assert credential_of(BusConfig(), "sim") is None


def test_one_that_is_not_there_is_named(tmp_path):
    with pytest.raises(
        ConfigError, match=r"bus.credentials: .*/sim.json5: No such file.*; `hyrecro certs new` makes them"
    ):
        credential_of(secure(tmp_path), "sim")
    with pytest.raises(ConfigError, match=r"bus.credentials: .*/router/ca.pem: No such file"):
        router_settings(tmp_path)


def test_tls_and_credentials_belong_together():
    with pytest.raises(
        ConfigError, match=r"--set: bus: endpoint tls/127.0.0.1:1 needs credentials: `hyrecro certs new`"
    ):
        load_config(overrides=["bus.endpoint=tls/127.0.0.1:1"])
    with pytest.raises(ConfigError, match=r"--set: bus: credentials need an endpoint that begins with tls/ or quic/"):
        load_config(overrides=["bus.credentials=certs"])
