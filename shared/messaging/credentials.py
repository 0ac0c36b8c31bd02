"""Which files a process shows on a secure bus. They are Zenoh configurations, so the stock tools take them too."""

from __future__ import annotations

import json
from pathlib import Path

from shared.errors import ConfigError
from shared.runtime.config import BusConfig
from shared.runtime.roles import role_of
from shared.runtime.section import CONFIGS_DIR

SECURE_ROUTER = CONFIGS_DIR / "zenoh" / "secure" / "router.json5"
"""What the router of a secure bus lets whom do."""
WHY_REFUSED = (
    "the router refuses a certificate that has expired or is of another authority, and another password than its own; "
    "or it is itself not called so in its certificate (`hyrecro certs show`)"
)
"""Neither side of a connection says what it dislikes of the other."""
_ROUTER_FILES = {
    "transport/link/tls/root_ca_certificate": "ca.pem",
    "transport/link/tls/listen_certificate": "router.pem",
    "transport/link/tls/listen_private_key": "router.key",
    "transport/auth/usrpwd/dictionary_file": "passwords",
}


def credential_of(config: BusConfig, name: str) -> Path | None:
    """The file by which a service, or an operator, proves who it is; None on a bus that asks nobody.

    Raises:
        ConfigError: `bus.credentials` has no such file, or it cannot be read.
    """
    path = config.credentials
    if path is None:
        return None
    if path.is_dir():
        path = path / f"{role_of(name)}.json5"
    return _readable(path)


def router_settings(folder: Path) -> dict[str, str]:
    """Where a router finds what it proves itself and checks others by: Zenoh's settings, as JSON.

    Raises:
        ConfigError: a file is not there, or cannot be read.
    """
    return {key: json.dumps(str(_readable(folder / "router" / name))) for key, name in _ROUTER_FILES.items()}


def _readable(path: Path) -> Path:
    try:
        path.open("rb").close()
    except OSError as error:
        hint = "; `hyrecro certs new` makes them" if isinstance(error, FileNotFoundError) else ""
        raise ConfigError([f"bus.credentials: {path}: {error.strerror}{hint}"]) from error
    return path
