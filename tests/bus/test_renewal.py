"""Which certificates are made and renewed, with a clock of the test's own, and that a bus works with what is made."""

from __future__ import annotations

from contextlib import ExitStack
from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509
from cryptography.exceptions import InvalidSignature

from contextpolicy.bus.expiry import end
from contextpolicy.bus.issuing import AUTHORITY_LIFETIME, BEGIN, LIFETIME, found_authority, pem, signing_files
from contextpolicy.bus.renewal import RENEW, Place, Release, due, moment
from contextpolicy.bus.roles import ROLES
from contextpolicy.bus.session import open_router
from contextpolicy.bus.signatures import Signer, Verifier
from tests.bus.client import client_of
from tests.ports import free_port

NOW = datetime(2026, 11, 24, tzinfo=UTC)
DAY = timedelta(days=1)
FOREIGN = pem([found_authority("x", NOW).certificate])
HOSTS = ("robot.local", "127.0.0.1", "::1")
RELEASE = Release("system", "ctxp", names=HOSTS, shared=("robot", "system"))


def own(name):
    return Place("system", f"ctxp-{name}")


@pytest.fixture(scope="module")
def made():
    return dict(due(RELEASE, {}, NOW))


def renewed(made, now=NOW, release=RELEASE):
    """The Secrets that are written."""
    return set(due(release, made, now))


def certificate(files):
    return x509.load_pem_x509_certificate(files["tls.crt"])


def directory(files, folder):
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder


def test_first_run_creates_everything_authority_first(made):
    assert made.keys() == set(RELEASE.places())
    assert {place.name.removeprefix("ctxp-bus-") for place in made if place.namespace == "system"} == {
        *("authority", "router", *ROLES),
        "ctxp-signing",
    }
    assert {place.name for place in made if place.namespace == "robot"} == {"ctxp-bus-sensor", "ctxp-bus-module"}
    bus = [place for place in made if place != own("signing")]
    assert bus[0] == own("bus-authority")
    assert {made[place]["ca.crt"] for place in bus} == {made[bus[0]]["tls.crt"]}


def test_valid_files_are_not_renewed(made):
    assert renewed(made) == set()
    assert renewed(made, NOW + LIFETIME - RENEW) == set()


def test_certificates_are_renewed_long_before_they_end(made):
    assert renewed(made, NOW + LIFETIME - RENEW + DAY) == set(RELEASE.roles())


def test_authority_rotation_keeps_clients_and_routers_trusted():
    """A client with files of up to a year ago, and a router with today's, trust each other at any time."""
    found: dict[Place, dict[str, bytes]] = {}
    former: list[dict[str, bytes]] = []
    issuers = set()
    for month in range(45 * 12):
        now = NOW + month * 30 * DAY
        found |= {place: {**found.get(place, {}), **files} for place, files in due(RELEASE, found, now).items()}
        assert renewed(found, now) == set()
        issuers.add(found[own("bus-authority")]["tls.crt"])
        former = [*former, found[own("bus-sensor")]][-12:]
        router = found[own("bus-router")]
        assert len(x509.load_pem_x509_certificates(router["ca.crt"])) <= 3
        assert all(trusts(client, router) for client in former)
        assert all(trusts(router, client) for client in former if not_ended(client, now))
    assert len(issuers) == 3


def not_ended(files, now):
    return certificate(files).not_valid_after_utc > now


def trusts(files, peer):
    return any(issued(peer, one) for one in x509.load_pem_x509_certificates(files["ca.crt"]))


def issued(peer, authority):
    try:
        certificate(peer).verify_directly_issued_by(authority)
    except InvalidSignature:
        return False
    return True


def test_an_authority_that_ends_soon_is_succeeded_at_once(made):
    """A robot was off for years: there is no time for an heir."""
    later = NOW + AUTHORITY_LIFETIME - LIFETIME + DAY
    after = made | due(RELEASE, made, later)
    assert after[own("bus-authority")]["tls.crt"] != made[own("bus-authority")]["tls.crt"]
    assert len(x509.load_pem_x509_certificates(after[own("bus-router")]["ca.crt"])) == 2
    past = NOW + AUTHORITY_LIFETIME + DAY
    assert len(x509.load_pem_x509_certificates(due(RELEASE, made, past)[own("bus-router")]["ca.crt"])) == 2


@pytest.mark.parametrize("years", [-56, -1, 7, 80])
def test_implausible_clock_is_ignored(made, years):
    time = moment(RELEASE, made, NOW + years * LIFETIME, NOW)
    assert (time, renewed(made, time)) == (NOW, set())


@pytest.mark.parametrize("years", [0, 1, 5])
def test_a_robot_that_was_off_for_years_renews(made, years):
    assert moment(RELEASE, made, NOW + years * LIFETIME, NOW) == NOW + years * LIFETIME


def test_clock_is_trusted_on_a_fresh_install():
    assert moment(RELEASE, {}, NOW + 9 * LIFETIME, NOW) == NOW + 9 * LIFETIME


@pytest.mark.parametrize("bundle", [b"", b"garbage", b"-----BEGIN nonsense", FOREIGN])
def test_bundle_without_the_authority_is_recreated(made, bundle):
    broken = made | {own("bus-authority"): made[own("bus-authority")] | {"ca.crt": bundle}}
    changes = due(RELEASE, broken, NOW)
    signed = certificate(made[own("bus-authority")])
    assert signed in x509.load_pem_x509_certificates(changes[own("bus-authority")]["ca.crt"])
    assert renewed(broken | changes) == set()


@pytest.mark.parametrize("files", [{"tls.key": b"garbage"}, {"tls.crt": b"garbage"}, {"tls.key": b""}])
def test_invalid_signing_key_is_recreated(made, files):
    assert renewed(made | {own("signing"): made[own("signing")] | files}) == {own("signing")}


@pytest.mark.parametrize("what", ["tls.crt", "tls.key", "ca.crt"])
@pytest.mark.parametrize("content", [None, b"", b"-----BEGIN nonsense", b"\xff\xfe"])
def test_missing_or_invalid_files_are_recreated(made, what, content):
    files = {name: old for name, old in made[own("bus-sensor")].items() if name != what}
    broken = made | {own("bus-sensor"): files if content is None else files | {what: content}}
    assert renewed(broken) == {own("bus-sensor")}


@pytest.mark.parametrize("other", ["bus-module", "bus-router"])
def test_certificate_of_another_role_is_recreated(made, other):
    assert renewed(made | {own("bus-sensor"): made[own(other)]}) == {own("bus-sensor")}


def test_mismatched_key_is_recreated(made):
    mixed = made[own("bus-sensor")] | {"tls.key": made[own("bus-module")]["tls.key"]}
    assert renewed(made | {own("bus-sensor"): mixed}) == {own("bus-sensor")}


def test_key_longer_than_ours_is_replaced_unread(made):
    """Whoever fills a robot's Secret may have chosen one that takes hours to check, as of huge primes."""
    long = made[own("bus-sensor")] | {"tls.key": b"#" * 512 + made[own("bus-sensor")]["tls.key"]}
    assert renewed(made | {own("bus-sensor"): long}) == {own("bus-sensor")}


def test_new_authority_reissues_every_certificate(made):
    other = due(RELEASE, {}, NOW)[own("bus-authority")]
    assert renewed(made | {own("bus-authority"): other}) == set(RELEASE.roles())
    assert renewed(made | {own("bus-authority"): {}}) == {own("bus-authority"), *RELEASE.roles()}


def test_changed_router_names_renew_only_its_certificate(made):
    release = Release("system", "ctxp", names=(*HOSTS, "10.0.0.9"), shared=RELEASE.shared)
    assert renewed(made, release=release) == {own("bus-router")}


def test_the_routers_certificate_has_all_its_names(made):
    names = certificate(made[own("bus-router")]).extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["robot.local"]
    assert [str(one) for one in names.get_values_for_type(x509.IPAddress)] == ["127.0.0.1", "::1"]


def test_added_namespace_gets_its_own_certificates(made):
    release = Release("system", "ctxp", names=HOSTS, shared=("robot", "lab"))
    assert renewed(made, release=release) == {Place("lab", "ctxp-bus-sensor"), Place("lab", "ctxp-bus-module")}


def test_the_key_of_the_plans_is_made_once_and_stays(made):
    assert renewed(made | {own("signing"): {}}) == {own("signing")}
    rotating = signing_files()
    both = {"tls.key": rotating["tls.key"], "tls.crt": rotating["tls.crt"] + made[own("signing")]["tls.crt"]}
    assert renewed(made | {own("signing"): both}, NOW + 100 * LIFETIME) - set(RELEASE.roles()) == {own("bus-authority")}


@pytest.mark.parametrize(
    ("release", "places"),
    [
        (Release("system", "ctxp", bus=False), {own("signing")}),
        (Release("system", "ctxp", bus=False, signing=False), set()),
    ],
)
def test_secrets_that_users_bring_are_not_renewed(release, places):
    assert set(release.places()) == renewed({}, release=release) == places


def test_every_certificate_is_valid_since_1970(made):
    """A robot without a clock battery boots then."""
    certificates = [certificate(files) for files in made.values()]
    assert {one.not_valid_before_utc for one in certificates} == {BEGIN} == {datetime(1970, 1, 1, tzinfo=UTC)}


def test_bundle_expires_with_its_earliest_certificate():
    two = pem([found_authority("a", NOW + DAY).certificate, found_authority("b", NOW).certificate])
    assert end(two) == NOW + AUTHORITY_LIFETIME
    assert end(b"") is None


def test_every_role_connects_with_issued_certificates(made, tmp_path):
    endpoint = f"tls/127.0.0.1:{free_port()}"
    with open_router([endpoint], directory(made[own("bus-router")], tmp_path / "router")), ExitStack() as sessions:
        for role in ROLES:
            credentials = directory(made[own(f"bus-{role}")], tmp_path / role)
            session = sessions.enter_context(client_of(endpoint, credentials))
            assert list(session.info.routers_zid())


def test_certificates_of_the_previous_authority_are_accepted_after_rotation(made, tmp_path):
    after = made | due(RELEASE, made, NOW + AUTHORITY_LIFETIME - LIFETIME + DAY)
    endpoint = f"tls/127.0.0.1:{free_port()}"
    former = made[own("bus-sensor")] | {"ca.crt": after[own("bus-sensor")]["ca.crt"]}
    with (
        open_router([endpoint], directory(after[own("bus-router")], tmp_path / "router")),
        client_of(endpoint, directory(former, tmp_path / "sensor")) as session,
    ):
        assert list(session.info.routers_zid())


def test_agents_can_check_what_the_operator_signs(made, tmp_path):
    keys, now = directory(made[own("signing")], tmp_path / "signing"), 10**18
    assert Verifier(keys).check("key", b"plan", Signer(keys).sign("key", b"plan", now), now) == now
