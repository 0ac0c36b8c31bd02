"""Credentials of a secure bus: what they say, who can read them, and what the user reads of those that are no good."""

import base64
import json
import stat
from datetime import timedelta

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID
from typer.testing import CliRunner

from cli.certificates import Authority, credential_files, holder_of, now_utc
from cli.certs_commands import app, write_files
from shared.runtime.roles import ROLES

runner = CliRunner()
NOW = now_utc()


@pytest.fixture(scope="module")
def files():
    authority = Authority(NOW, NOW + timedelta(days=7))
    return {str(path): content for path, content in credential_files(authority, ROLES, ["10.0.0.7", "arm.lan"]).items()}


def certificate_of(files, path):
    content = files[path]
    if path.endswith(".json5"):
        content = base64.b64decode(json.loads(content)["transport"]["link"]["tls"]["connect_certificate_base64"])
    return x509.load_pem_x509_certificate(content)


def test_there_is_one_file_a_role_and_four_for_the_router(files):
    router = {"router/ca.pem", "router/router.pem", "router/router.key", "router/passwords"}
    assert set(files) == router | {f"{role}.json5" for role in ROLES}


@pytest.mark.parametrize("role", ROLES)
def test_a_role_is_certified_by_the_authority_as_a_client_only(files, role):
    certificate, ca = certificate_of(files, f"{role}.json5"), certificate_of(files, "router/ca.pem")
    certificate.verify_directly_issued_by(ca)
    purposes = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert list(purposes) == [ExtendedKeyUsageOID.CLIENT_AUTH]
    assert certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca is False
    assert holder_of(files[f"{role}.json5"]).name == role
    user = json.loads(files[f"{role}.json5"])["transport"]["auth"]["usrpwd"]
    assert f"{user['user']}:{user['password']}\n" in files["router/passwords"].decode()
    assert user["user"] == role


def test_the_router_is_certified_for_every_name_that_it_is_called_by(files):
    certificate = certificate_of(files, "router/router.pem")
    certificate.verify_directly_issued_by(certificate_of(files, "router/ca.pem"))
    assert holder_of(files["router/router.pem"]).hosts == ("10.0.0.7", "arm.lan", "localhost", "127.0.0.1", "router")
    assert json.loads(files["sim.json5"])["connect"]["endpoints"] == ["tls/10.0.0.7:7447"]


def test_no_key_of_the_authority_is_kept_and_no_secret_is_shared(files):
    keys = [line for name, content in files.items() if name.endswith("router.key") for line in content.splitlines()]
    assert keys.count(b"-----BEGIN PRIVATE KEY-----") == 1
    tls = [json.loads(files[f"{role}.json5"])["transport"] for role in ROLES]
    assert len({one["link"]["tls"]["connect_private_key_base64"] for one in tls}) == len(ROLES)
    assert len({one["auth"]["usrpwd"]["password"] for one in tls}) == len(ROLES)
    assert not any("PRIVATE" in files[name].decode() for name in ("router/ca.pem", "router/router.pem"))


def test_new_writes_for_the_owner_alone_and_show_lists_them(tmp_path):
    folder = tmp_path / "a" / "certs"
    assert runner.invoke(app, ["new", str(folder), "--days", "3"]).exit_code == 0
    modes = {path: stat.S_IMODE(path.stat().st_mode) for path in (folder, *folder.rglob("*"))}
    assert all(mode == (0o700 if path.is_dir() else 0o600) for path, mode in modes.items())
    shown = runner.invoke(app, ["show", str(folder), "--json"])
    assert shown.exit_code == 0
    listed = json.loads(shown.stdout)
    assert {row["name"] for row in listed["certificates"]} == {"HyReCRo test CA", "router", *ROLES}
    assert listed["num_expired"] == 0
    assert "3 days left" in runner.invoke(app, ["show", str(folder / "viewer.json5")]).stdout


def test_what_has_expired_is_said_and_fails(tmp_path):
    authority = Authority(NOW - timedelta(days=2), NOW - timedelta(days=1))
    write_files(tmp_path / "certs", credential_files(authority, ROLES))
    shown = runner.invoke(app, ["show", str(tmp_path / "certs")])
    assert shown.exit_code == 1
    assert shown.stdout.count("EXPIRED") == len(ROLES) + 2


@pytest.mark.parametrize("content", [b"", b"{}", b"[1]", b"-----BEGIN CERTIFICATE-----\nAA==", b"\xff\xfe", None])
def test_what_is_no_certificate_is_refused_by_its_name(tmp_path, content):
    path = tmp_path / "x.json5"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(Exception, match=r"x.json5: (neither a PEM|No such file)"):
        runner.invoke(app, ["show", str(path)], catch_exceptions=False)


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "mine").write_text("kept")
    with pytest.raises(Exception, match=r"must be a new or an empty folder; nothing is overwritten"):
        runner.invoke(app, ["new", str(tmp_path)], catch_exceptions=False)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


@pytest.mark.parametrize("host", ["ä.lan", "a b", "", "*"])
def test_a_host_that_no_certificate_can_name_is_refused(tmp_path, host):
    with pytest.raises(Exception, match=r"--host"):
        runner.invoke(app, ["new", str(tmp_path / "certs"), "--host", host], catch_exceptions=False)
    assert not (tmp_path / "certs").exists()
