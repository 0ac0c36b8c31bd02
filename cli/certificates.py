"""A test CA and what it certifies: the router, and a credential a role, each a file for the stock Zenoh tools too."""

from __future__ import annotations

import base64
import ipaddress
import json
import re
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

ROUTER = "router"
ROUTER_HOSTS = ("localhost", "127.0.0.1", ROUTER)
"""How clients may always call the router: by loopback, and by its name in docker-compose.yml."""
_CA_NAME = "HyReCRo test CA"
_HOST_NAME = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?")
_CLOCK_SKEW = timedelta(minutes=5)
_PASSWORD_BYTES = 32


@dataclass(frozen=True, slots=True)
class Certified:
    """A certificate and its private key, both as PEM."""

    certificate: bytes
    key: bytes


class Authority:
    """Certifies with a P-256 key that is nowhere stored: what it has issued is all it will ever issue."""

    def __init__(self, not_before: datetime, not_after: datetime) -> None:
        self._not_before, self._not_after = not_before - _CLOCK_SKEW, not_after
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = _name(_CA_NAME)
        usage = _key_usage(signs_certificates=True)
        builder = self._builder(self._name, self._key.public_key(), not_after)
        builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        self.certificate = _pem(builder.add_extension(usage, critical=True).sign(self._key, hashes.SHA256()))

    def router(self, hosts: Sequence[str]) -> Certified:
        """For a server that clients call by one of `hosts`.

        Raises:
            ValueError: one that is neither a name nor an address.
        """
        names = x509.SubjectAlternativeName([_general_name(host) for host in hosts])
        return self._issue(ROUTER, ExtendedKeyUsageOID.SERVER_AUTH, names)

    def client(self, role: str, not_after: datetime | None = None) -> Certified:
        """For a client of this role; it cannot pass for a router. It holds as long as the CA, or until `not_after`."""
        names = x509.SubjectAlternativeName([x509.DNSName(role)])
        return self._issue(role, ExtendedKeyUsageOID.CLIENT_AUTH, names, not_after)

    def _issue(
        self,
        name: str,
        purpose: x509.ObjectIdentifier,
        names: x509.SubjectAlternativeName,
        not_after: datetime | None = None,
    ) -> Certified:
        key = ec.generate_private_key(ec.SECP256R1())
        builder = self._builder(_name(name), key.public_key(), not_after)
        builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        builder = builder.add_extension(_key_usage(signs_certificates=False), critical=True)
        builder = builder.add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        builder = builder.add_extension(names, critical=False)
        certificate = builder.sign(self._key, hashes.SHA256())
        private = key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
        return Certified(_pem(certificate), private)

    def _builder(
        self, subject: x509.Name, public_key: ec.EllipticCurvePublicKey, not_after: datetime | None
    ) -> x509.CertificateBuilder:
        return (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(self._name)
            .public_key(public_key)
            .serial_number(x509.random_serial_number())
            .not_valid_before(self._not_before)
            .not_valid_after(not_after or self._not_after)
        )


def credential_files(ca: Authority, roles: Sequence[str], hosts: Sequence[str] = ()) -> dict[Path, bytes]:
    """What a secure bus needs, by path within its folder: `router/` for the router, `<role>.json5` for each client.

    A client's file is a Zenoh configuration with everything in it: the router's address (the first host), the CA's
    certificate, the client's own and its key, user and password. The role is both the common name and the user.

    Raises:
        ValueError: a host that is neither a name nor an address.
    """
    router = ca.router(tuple(dict.fromkeys((*hosts, *ROUTER_HOSTS))))
    passwords = {role: secrets.token_hex(_PASSWORD_BYTES) for role in roles}
    host = hosts[0] if hosts else ROUTER_HOSTS[1]
    endpoint = f"tls/[{host}]:7447" if ":" in host else f"tls/{host}:7447"
    folder = Path(ROUTER)
    files = {
        folder / "ca.pem": ca.certificate,
        folder / "router.pem": router.certificate,
        folder / "router.key": router.key,
        folder / "passwords": "".join(f"{role}:{password}\n" for role, password in passwords.items()).encode(),
    }
    for role, password in passwords.items():
        profile = _profile(endpoint, ca.certificate, ca.client(role), role, password)
        files[Path(f"{role}.json5")] = (json.dumps(profile, indent=2) + "\n").encode()
    return files


@dataclass(frozen=True, slots=True)
class Holder:
    """Who a certificate was issued to, for which hosts (routers only), until when."""

    name: str
    hosts: tuple[str, ...]
    not_after: datetime

    def days_left(self, now: datetime) -> float:
        """Days until it expires; negative when it has."""
        return (self.not_after - now) / timedelta(days=1)


def holder_of(content: bytes) -> Holder:
    """Reads a certificate: PEM, or a client's file.

    Raises:
        ValueError, KeyError, TypeError: neither of the two.
    """
    if not content.startswith(b"-----BEGIN"):
        content = base64.b64decode(json.loads(content)["transport"]["link"]["tls"]["connect_certificate_base64"])
    certificate = x509.load_pem_x509_certificate(content)
    name = str(certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)
    return Holder(name, _hosts(certificate), certificate.not_valid_after_utc)


def _hosts(certificate: x509.Certificate) -> tuple[str, ...]:
    try:
        purposes = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ()
    return tuple(str(name.value) for name in names) if ExtendedKeyUsageOID.SERVER_AUTH in purposes else ()


def _profile(endpoint: str, ca: bytes, certified: Certified, user: str, password: str) -> dict[str, Any]:
    def text(pem: bytes) -> str:
        return base64.b64encode(pem).decode()

    return {
        "mode": "client",
        "connect": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {
            "auth": {"usrpwd": {"user": user, "password": password}},
            "link": {
                "tls": {
                    "root_ca_certificate_base64": text(ca),
                    "connect_certificate_base64": text(certified.certificate),
                    "connect_private_key_base64": text(certified.key),
                    "enable_mtls": True,
                }
            },
        },
    }


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        if _HOST_NAME.fullmatch(host) is None:
            raise ValueError(f"'{host}' is neither an address nor a name of letters, digits, - and .") from None
        return x509.DNSName(host)


def _key_usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def now_utc() -> datetime:
    """To the second, as certificates tell it."""
    return datetime.now(UTC).replace(microsecond=0)
