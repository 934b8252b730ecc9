"""Signed plans: an Ed25519 signature in a message's attachment proves that the operator sent it, whatever its route.

The attachment is the time of signing (eight bytes, big-endian nanoseconds since 1970) and the signature (64 bytes) over
that time, the key and the payload. A withdrawal has no payload and is signed too: a forged one would undo a plan. The
payload itself is unchanged. For a plan of 4 kB signing takes 51 us and verifying 135 us (medians).
"""

from __future__ import annotations

import struct
import time
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509 import load_pem_x509_certificates

from contextpolicy.errors import OrderError, SigningKeyError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

T = TypeVar("T")

PRIVATE_KEY, CERTIFICATES = "tls.key", "tls.crt"
"""The files of a Secret of type kubernetes.io/tls, as cert-manager writes it. The certificate is only the public key's
envelope: its key is trusted because it is in that file; issuer and dates are not checked."""
UNPROVEN = frozenset({"Unsigned", "Forged"})
"""The reasons to refuse a message that anybody may have sent; the operator too, with another key than is known here."""
MAX_AGE = 10.0
"""Seconds, by the verifier's clock, in either direction: plans arrive in milliseconds, but nodes' clocks differ."""

LOOK = 0.5
"""Seconds after which the agent looks again whether its keys were replaced: one that was removed counts no longer."""

_DOMAIN = b"contextpolicy plan, version 1\n"
_TIME = struct.Struct(">Q")
_SIGNATURE = 64


class _KeyFile(Generic[T]):
    """A parsed file, reread when it is replaced: the kubelet swaps a mounted Secret's files when the Secret changes."""

    def __init__(self, path: Path, parse: Callable[[bytes], T]) -> None:
        self._path, self._parse = path, parse
        self._version = 0, 0
        self.content = self.renewed() or self._read()

    def renewed(self, otherwise: T | None = None) -> T | None:
        """The new content if the file was replaced, else None.

        One that is gone or holds no key leaves the last good content, or `otherwise` if that is given.
        """
        version = 0, 0
        try:
            # `stat` follows the kubelet's symlinks, so a swapped Secret shows as another inode.
            status = self._path.stat()
            version = status.st_ino, status.st_mtime_ns
            if version == self._version:
                return None
            content = self._read()
        except (FileNotFoundError, SigningKeyError):
            if otherwise is None:
                return None
            content = otherwise
        except OSError:
            return None
        self._version, self.content = version, content
        return content

    def _read(self) -> T:
        try:
            return self._parse(self._path.read_bytes())
        except (OSError, ValueError, TypeError) as error:
            raise SigningKeyError(f"{self._path}: expected an Ed25519 key in PEM: {type(error).__name__}") from error


NOBODY: tuple[Ed25519PublicKey, ...] = ()
"""Whose signatures count when the certificates are gone or make no sense: a key that was taken out never does again."""


class PlanSigner(Protocol):
    """Proves to agents that a message comes from the operator."""

    def sign(self, key: str, payload: bytes | None, now: int) -> bytes | None:
        """The attachment for a message on `key`, None where nothing is signed.

        A `payload` of None is a withdrawal, `now` is in ns since 1970.
        """


class UnsignedPlans:
    """Without a key: plans are published unsigned, and agents ignore them."""

    def sign(self, key: str, payload: bytes | None, now: int) -> None:
        """No attachment."""


class Signer:
    """The operator's side."""

    def __init__(self, directory: Path) -> None:
        """SigningKeyError when there is no key."""
        self._key = _KeyFile(directory / PRIVATE_KEY, _private_key)

    def sign(self, key: str, payload: bytes | None, now: int) -> bytes:
        """The attachment for a message on `key`; a `payload` of None is a withdrawal, `now` is in ns since 1970."""
        self._key.renewed()
        return _TIME.pack(now) + self._key.content.sign(_signed(key, payload, now))


class Verifier:
    """The agent's side; it may be called on any thread. `clock` shows seconds and never steps."""

    def __init__(self, directory: Path, clock: Callable[[], float] = time.monotonic) -> None:
        """SigningKeyError when there is no certificate."""
        self._keys = _KeyFile(directory / CERTIFICATES, _public_keys)
        self._clock, self._looked = clock, clock()

    def check(self, key: str, payload: bytes | None, attachment: bytes | None, now: int) -> int:
        """Return the time of signing, in ns since 1970 like `now`; OrderError when the sender is not proven."""
        if attachment is None or len(attachment) != _TIME.size + _SIGNATURE:
            raise OrderError("Unsigned", f"{key}: not signed by the operator")
        [signed] = _TIME.unpack_from(attachment)
        if not self._proven(attachment[_TIME.size :], _signed(key, payload, signed)):
            raise OrderError("Forged", f"{key}: not signed with the operator's key")
        age = (now - signed) / 1e9
        if abs(age) > MAX_AGE:
            raise OrderError(
                "TooOld",
                f"{key}: signed {age:.1f} s ago by this node's clock; expected at most {MAX_AGE:g} s",
                signed=int(signed),
            )
        return int(signed)

    def _proven(self, signature: bytes, content: bytes) -> bool:
        """Look for new keys when a signature fails, and else now and then: most valid messages cost no `stat`."""
        now = self._clock()
        if now - self._looked >= LOOK:
            self._looked = now
            self._keys.renewed(NOBODY)
        return _by_any(self._keys.content, signature, content) or _by_any(
            self._keys.renewed(NOBODY) or (), signature, content
        )


def _by_any(keys: tuple[Ed25519PublicKey, ...], signature: bytes, content: bytes) -> bool:
    for key in keys:
        try:
            key.verify(signature, content)
        except InvalidSignature:
            continue
        return True
    return False


def _signed(key: str, payload: bytes | None, now: int) -> bytes:
    kind = b"withdrawn" if payload is None else b"plan"
    return b"\n".join((_DOMAIN + _TIME.pack(now) + key.encode(), kind, payload or b""))


def _private_key(pem: bytes) -> Ed25519PrivateKey:
    key = load_pem_private_key(pem, password=None)
    if not isinstance(key, Ed25519PrivateKey):
        raise TypeError
    return key


def _public_keys(pem: bytes) -> tuple[Ed25519PublicKey, ...]:
    """The keys of all certificates in the file: more than one while a key is being replaced."""
    keys = [certificate.public_key() for certificate in load_pem_x509_certificates(pem)]
    if not all(isinstance(key, Ed25519PublicKey) for key in keys):
        raise TypeError
    return tuple(key for key in keys if isinstance(key, Ed25519PublicKey))
