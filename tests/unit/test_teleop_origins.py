"""Another site's page, open in the operator's browser, must not reach the robot through the teleop server."""

import contextlib
import io

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from services.teleop.origins import only_from, origins_of
from shared.runtime.config_loading import load_config
from tests.support.browser import free_port

OTHER_SITES = ["http://evil.example", "https://127.0.0.1:{port}", "http://127.0.0.1:1", "http://127.0.0.1", "null"]


@pytest.fixture(scope="module")
def port():
    port = free_port()
    config = load_config(overrides=[f"teleop.port={port}", "teleop.origins=[http://robot.lan:8080]"]).teleop
    with contextlib.redirect_stdout(io.StringIO()), only_from(origins_of(config)):
        server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    yield port
    server.stop()


def socket_of(port, origin):
    return connect(f"ws://127.0.0.1:{port}", origin=origin, subprotocols=[f"viser-v{viser.__version__}"])


@pytest.mark.parametrize("origin", OTHER_SITES)
def test_another_sites_page_is_refused(port, origin):
    with pytest.raises(InvalidStatus) as refused, socket_of(port, origin.format(port=port)):
        pass
    assert refused.value.response.status_code == 403


@pytest.mark.parametrize(
    "origin", ["http://127.0.0.1:{port}", "http://localhost:{port}", "http://robot.lan:8080", None]
)
def test_the_page_itself_is_let_in(port, origin):
    with socket_of(port, origin and origin.format(port=port)) as socket:
        assert socket.recv(timeout=10)


def test_the_library_is_as_before():
    from websockets.asyncio import server

    assert isinstance(server.serve, type)
