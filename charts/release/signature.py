"""A signature by a key of one's own: ECDSA on P-256 with SHA-256, which openssl and cosign verify without a network."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from tests.node.errors import ClusterError

if TYPE_CHECKING:
    from pathlib import Path

log = logging.getLogger(__name__)

PUBLIC_KEY = "release.pub"


def sign(file: Path, key: Path) -> Path:
    """Put the signature of a file beside it, and the key that verifies it."""
    private = _read(key) if key.exists() else _make(key)
    public = private.public_key().public_bytes(
        serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
    )
    (file.parent / PUBLIC_KEY).write_bytes(public)
    signature = file.with_name(f"{file.name}.sig")
    signature.write_bytes(private.sign(file.read_bytes(), ec.ECDSA(hashes.SHA256())))
    return signature


def _read(key: Path) -> ec.EllipticCurvePrivateKey:
    try:
        private = serialization.load_pem_private_key(key.read_bytes(), password=None)
    except (ValueError, TypeError) as error:
        raise ClusterError(f"{key}: expected a private key in PEM without a password: {error}") from error
    if not isinstance(private, ec.EllipticCurvePrivateKey) or not isinstance(private.curve, ec.SECP256R1):
        raise ClusterError(f"{key}: expected an ECDSA key on the curve P-256")
    return private


def _make(key: Path) -> ec.EllipticCurvePrivateKey:
    log.info("%s: created; anyone who has it can sign releases", key)
    private = ec.generate_private_key(ec.SECP256R1())
    text = private.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    key.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    key.touch(mode=0o600)
    key.write_bytes(text)
    return private
