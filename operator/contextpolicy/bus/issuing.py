"""The bus's own authority, and the certificates that it issues.

Every certificate is valid from 1970 on: a robot without a clock battery boots in 1970, or when its image was built, and
must be on its bus before anything has set its clock. What bounds a certificate is its end.
"""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric import ec, ed25519
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, load_pem_private_key
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from contextpolicy.bus.credentials import CA, CERTIFICATE, KEY

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from cryptography.hazmat.primitives.asymmetric.types import CertificatePublicKeyTypes, PrivateKeyTypes

BEGIN = datetime(1970, 1, 1, tzinfo=UTC)
NEVER = datetime(9999, 12, 31, 23, 59, 59, tzinfo=UTC)
"""The end of what has none (RFC 5280, section 4.1.2.5)."""
LIFETIME = timedelta(days=365)
AUTHORITY_LIFETIME = timedelta(days=20 * 365)
LONGEST_KEY = 512
"""Bytes of a key's file that is read where tenants may write it; ours have half as many. A long one of somebody else
may take hours: its factors are checked to be prime."""

UNREADABLE = (
    KeyError,
    ValueError,
    TypeError,
    InvalidSignature,
    UnsupportedAlgorithm,
    x509.InvalidVersion,
    x509.DuplicateExtension,
    x509.UnsupportedGeneralNameType,
)
"""What a Secret may raise where it is not what we wrote."""


@dataclass(frozen=True, slots=True)
class Issuer:
    """An authority with its key."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    def issue(self, role: str, names: Iterable[str], now: datetime) -> dict[str, bytes]:
        """The files of a new certificate; `names` are the hosts and addresses of a server."""
        key = ec.generate_private_key(ec.SECP256R1())
        usages = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
        builder = (
            _unsigned(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, role)]), key.public_key(), now + LIFETIME)
            .issuer_name(self.certificate.subject)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        )
        if general := [_general(name) for name in names]:
            builder = builder.add_extension(x509.SubjectAlternativeName(general), critical=False)
        return _files(builder.sign(self.key, SHA256()), key)


def found_authority(name: str, now: datetime) -> Issuer:
    """A new authority."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    builder = (
        _unsigned(subject, key.public_key(), now + AUTHORITY_LIFETIME)
        .issuer_name(subject)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    )
    return Issuer(builder.sign(key, SHA256()), key)


def read_authority(files: Mapping[str, bytes]) -> Issuer | None:
    """The authority that a Secret holds; None when it holds none, or its key is of another."""
    try:
        certificate, key = x509.load_pem_x509_certificate(files[CERTIFICATE]), load_pem_private_key(files[KEY], None)
    except UNREADABLE:
        return None
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
        return None
    return Issuer(certificate, key)


def authority_files(issuer: Issuer) -> dict[str, bytes]:
    """What `read_authority` reads."""
    return _files(issuer.certificate, issuer.key)


def signing_files() -> dict[str, bytes]:
    """A new key of the plans. Its certificate is only the public key's envelope, so it never ends."""
    key = ed25519.Ed25519PrivateKey.generate()
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "plans")])
    return _files(_unsigned(subject, key.public_key(), NEVER).issuer_name(subject).sign(key, None), key)


def is_signing(files: Mapping[str, bytes]) -> bool:
    """Whether the files are a key of the plans, and certificates that agents can read."""
    try:
        x509.load_pem_x509_certificates(files[CERTIFICATE])
        return isinstance(load_pem_private_key(files[KEY], None), ed25519.Ed25519PrivateKey)
    except UNREADABLE:
        return False


def is_of(files: Mapping[str, bytes], issuer: Issuer, role: str, names: Iterable[str]) -> bool:
    """Whether the files are a certificate of this authority, for this role and these names, with its key."""
    if len(files.get(KEY, b"")) > LONGEST_KEY:
        return False
    try:
        certificate, key = x509.load_pem_x509_certificate(files[CERTIFICATE]), load_pem_private_key(files[KEY], None)
        certificate.verify_directly_issued_by(issuer.certificate)
        said = certificate.subject, _names(certificate)
    except UNREADABLE:
        return False
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, role)])
    return said == (subject, {_general(name) for name in names}) and key.public_key() == certificate.public_key()


def trusted(files: Mapping[str, bytes], now: datetime) -> list[x509.Certificate]:
    """The authorities of a `ca.crt` that have not ended; none where it can't be read."""
    try:
        return [one for one in x509.load_pem_x509_certificates(files[CA]) if one.not_valid_after_utc > now]
    except UNREADABLE:
        return []


def pem(certificates: Iterable[x509.Certificate]) -> bytes:
    """The certificates, one after the other."""
    return b"".join(one.public_bytes(Encoding.PEM) for one in certificates)


def _unsigned(subject: x509.Name, key: CertificatePublicKeyTypes, end: datetime) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(BEGIN)
        .not_valid_after(end)
    )


def _general(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        return x509.DNSName(name)


def _names(certificate: x509.Certificate) -> set[x509.GeneralName]:
    try:
        return set(certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value)
    except x509.ExtensionNotFound:
        return set()


def _files(certificate: x509.Certificate, key: PrivateKeyTypes) -> dict[str, bytes]:
    private = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    return {CERTIFICATE: certificate.public_bytes(Encoding.PEM), KEY: private}
