"""Who may decide: what is signed, what is not, and what is only said again."""

from __future__ import annotations

import pytest

from contextpolicy.bus.signatures import MAX_AGE, Signer, Verifier
from contextpolicy.errors import OrderError, SigningKeyError
from tests.bus.certificates import Authority, signing_keys

KEY, OTHER, PLAN = "contextpolicy/robot/delivery/plan", "contextpolicy/kube-system/x/plan", b'{"run": 1}'
NOW = 1_800_000_000_000_000_000
SECOND = 1_000_000_000


@pytest.fixture
def keys(tmp_path):
    return signing_keys(tmp_path / "keys")


@pytest.fixture
def signer(keys):
    return Signer(keys)


@pytest.fixture
def verifier(keys):
    return Verifier(keys)


def refusal(verifier, key, payload, attachment, now=NOW):
    with pytest.raises(OrderError) as caught:
        verifier.check(key, payload, attachment, now)
    return caught.value.reason


@pytest.mark.parametrize("payload", [PLAN, None, b""])
def test_signed_message_verifies_with_its_time(signer, verifier, payload):
    assert verifier.check(KEY, payload, signer.sign(KEY, payload, NOW), NOW + SECOND) == NOW


@pytest.mark.parametrize("attachment", [None, b"", b"x" * 71, b"x" * 73])
def test_missing_signature_is_refused(verifier, attachment):
    assert refusal(verifier, KEY, PLAN, attachment) == "Unsigned"


def test_signature_covers_payload_key_and_time(signer, verifier):
    attachment = signer.sign(KEY, PLAN, NOW)
    assert refusal(verifier, KEY, PLAN + b" ", attachment) == "Forged"
    assert refusal(verifier, OTHER, PLAN, attachment) == "Forged"
    assert refusal(verifier, KEY, None, attachment) == "Forged"
    assert refusal(verifier, KEY, PLAN, (NOW + 1).to_bytes(8, "big") + attachment[8:]) == "Forged"
    assert refusal(verifier, KEY, b"", signer.sign(KEY, None, NOW)) == "Forged"


def test_signature_by_another_key_is_refused(tmp_path, verifier):
    forger = Signer(signing_keys(tmp_path / "forger"))
    assert refusal(verifier, KEY, PLAN, forger.sign(KEY, PLAN, NOW)) == "Forged"


@pytest.mark.parametrize("sign", [-1, 1])
def test_plans_too_old_or_from_the_future_are_refused(signer, verifier, sign):
    attachment, limit = signer.sign(KEY, PLAN, NOW), int(MAX_AGE * SECOND)
    assert verifier.check(KEY, PLAN, attachment, NOW + sign * limit) == NOW
    with pytest.raises(OrderError) as caught:
        verifier.check(KEY, PLAN, attachment, NOW + sign * (limit + SECOND))
    assert (caught.value.reason, caught.value.signed) == ("TooOld", NOW)


def test_what_is_not_proven_has_no_time_of_signing(signer, verifier):
    attachment = signer.sign(KEY, PLAN, NOW)
    with pytest.raises(OrderError) as caught:
        verifier.check(OTHER, PLAN, attachment, NOW + 1000 * SECOND)
    assert (caught.value.reason, caught.value.signed) == ("Forged", None)


def test_a_new_key_is_taken_up_without_a_restart(keys, signer, verifier):
    before = signer.sign(KEY, PLAN, NOW)
    signing_keys(keys)
    assert verifier.check(KEY, PLAN, signer.sign(KEY, PLAN, NOW), NOW) == NOW
    assert refusal(verifier, KEY, PLAN, before) == "Forged"


def test_both_keys_verify_during_rotation(tmp_path, keys, signer, verifier):
    other = signing_keys(tmp_path / "other")
    (keys / "tls.crt").write_bytes((keys / "tls.crt").read_bytes() + (other / "tls.crt").read_bytes())
    for one in (signer, Signer(other)):
        assert verifier.check(KEY, PLAN, one.sign(KEY, PLAN, NOW), NOW) == NOW


def test_an_invalid_private_key_leaves_the_last_one_in_force(keys, signer, verifier):
    (keys / "tls.key").write_text("nonsense")
    assert verifier.check(KEY, PLAN, signer.sign(KEY, PLAN, NOW), NOW) == NOW


@pytest.mark.parametrize("content", [None, b"", b"nonsense"])
def test_missing_or_invalid_certificates_authenticate_no_sender(keys, signer, content):
    """The one that was there may have been taken out because somebody else had its key."""
    clock = iter(range(100))
    verifier, before = Verifier(keys, lambda: next(clock)), (keys / "tls.crt").read_bytes()
    (keys / "tls.crt").unlink() if content is None else (keys / "tls.crt").write_bytes(content)
    assert refusal(verifier, KEY, PLAN, signer.sign(KEY, PLAN, NOW)) == "Forged"
    (keys / "new.crt").write_bytes(before)
    (keys / "new.crt").rename(keys / "tls.crt")
    assert verifier.check(KEY, PLAN, signer.sign(KEY, PLAN, NOW), NOW) == NOW


def test_missing_ed25519_key_is_an_error(tmp_path):
    elliptic = Authority(tmp_path).issue("operator")
    for directory in (tmp_path / "nothing", elliptic):
        for side in (Signer, Verifier):
            with pytest.raises(SigningKeyError, match=r"tls\.(key|crt): expected an Ed25519 key"):
                side(directory)


def test_the_error_does_not_repeat_the_secret(tmp_path):
    (tmp_path / "tls.key").write_text("do-not-tell")
    with pytest.raises(SigningKeyError) as caught:
        Signer(tmp_path)
    assert "do-not-tell" not in str(caught.value) + repr(caught.value.__cause__)


def test_a_removed_key_is_refused_within_a_second(tmp_path, keys, signer):
    """Every message of the other is valid: no failure makes anybody look at the file."""
    clock = iter(n / 10 for n in range(100))
    other = signing_keys(tmp_path / "other")
    own, both = (keys / "tls.crt").read_bytes(), (other / "tls.crt").read_bytes() + (keys / "tls.crt").read_bytes()
    (keys / "tls.crt").write_bytes(both)
    verifier, removed = Verifier(keys, lambda: next(clock)), Signer(other)
    assert verifier.check(KEY, PLAN, removed.sign(KEY, PLAN, NOW), NOW) == NOW
    (keys / "new.crt").write_bytes(own)
    (keys / "new.crt").rename(keys / "tls.crt")
    for _ in range(10):
        assert verifier.check(KEY, PLAN, signer.sign(KEY, PLAN, NOW), NOW) == NOW
    assert refusal(verifier, KEY, PLAN, removed.sign(KEY, PLAN, NOW)) == "Forged"
