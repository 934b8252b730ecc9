"""An authority for tests, and the files that Secrets would hold."""

from __future__ import annotations

import ipaddress
import tempfile
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec, ed25519
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from contextpolicy.bus.roles import access_control

DAY = 86400.0
ROLES = [subject["id"] for subject in access_control()["subjects"]]


class Authority:
    """Issues certificates; clients of another authority trust none of them."""

    def __init__(self, directory: Path):
        self._directory = directory
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._certificate = (
            _unsigned("authority", "authority", self._key.public_key(), DAY)
            .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
            .sign(self._key, SHA256())
        )

    def issue(self, role: str, *, name: str = "", seconds: float = DAY) -> Path:
        """A directory with ca.crt, tls.crt and tls.key; an older certificate in it is replaced."""
        key = ec.generate_private_key(ec.SECP256R1())
        here = [x509.DNSName("localhost"), x509.IPAddress(ipaddress.ip_address("127.0.0.1"))]
        usages = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
        certificate = (
            _unsigned(role, "authority", key.public_key(), seconds)
            .add_extension(x509.SubjectAlternativeName(here), critical=False)
            .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
            .sign(self._key, SHA256())
        )
        directory = self.trust(name or role)
        _write(directory, certificate, key)
        return directory

    def trust(self, name: str) -> Path:
        """A directory with ca.crt only."""
        directory = self._directory / name
        if not directory.exists():
            directory.mkdir(parents=True)
            (directory / "ca.crt").write_bytes(self._certificate.public_bytes(Encoding.PEM))
        return directory


def signing_keys(directory: Path) -> Path:
    """A new key pair for plans: tls.key and tls.crt, replacing what was there."""
    directory.mkdir(parents=True, exist_ok=True)
    key = ed25519.Ed25519PrivateKey.generate()
    _write(directory, _unsigned("plans", "plans", key.public_key(), DAY).sign(key, None), key)
    return directory


def _unsigned(name: str, issuer: str, key, seconds: float) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]))
        .issuer_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, issuer)]))
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(seconds=seconds))
    )


def _write(directory: Path, certificate: x509.Certificate, key) -> None:
    """As a kubelet does it: a reader finds at any time both old files or both new ones."""
    data, fresh = directory / "..data", Path(tempfile.mkdtemp(dir=directory, prefix=".."))
    (fresh / "tls.crt").write_bytes(certificate.public_bytes(Encoding.PEM))
    (fresh / "tls.key").write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    (fresh / "link").symlink_to(fresh.name)
    (fresh / "link").replace(data)
    for name in ("tls.crt", "tls.key"):
        if not (directory / name).is_symlink():
            (directory / name).symlink_to(f"{data.name}/{name}")
