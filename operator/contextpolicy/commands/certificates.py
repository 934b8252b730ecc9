"""`contextpolicy certificates`: makes and renews a release's certificates, as the chart's Job and CronJob."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from contextpolicy.commands.cluster_access import add_cluster, api_server
from contextpolicy.commands.exit_codes import NO, OK
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterable
    from datetime import datetime

    from contextpolicy.bus.renewal import Place, Release
    from contextpolicy.cluster.api import ApiServer, Secret


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "certificates",
        help="make and renew the certificates of a release (what the chart's Job does)",
        description="Write the certificates that are missing, expire soon, or lack a name of the router into the "
        "Secrets of a release: an authority, a certificate for the router and each role, and the key that signs plans. "
        "The chart creates the Secrets empty. Valid certificates are left alone.",
    )
    parser.add_argument(
        "--release", metavar="NS/NAME", required=True, help="the release's namespace, and the prefix of its Secrets"
    )
    parser.add_argument("--no-bus", action="store_true", help="write no certificates for the bus: you bring your own")
    parser.add_argument("--no-signing", action="store_true", help="write no key for signing plans: you bring your own")
    parser.add_argument(
        "--router-name", metavar="NAME", action="append", default=[], help="a host or address of the router; repeatable"
    )
    parser.add_argument(
        "--share", metavar="NS", action="append", default=[], help="a namespace of robots; repeatable (default: none)"
    )
    add_cluster(parser)
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Renew what is due, and print it."""
    from datetime import UTC, datetime

    from contextpolicy.bus.renewal import Release

    namespace, _, prefix = arguments.release.partition("/")
    release = Release(
        namespace,
        prefix,
        names=arguments.router_name,
        shared=arguments.share,
        bus=not arguments.no_bus,
        signing=not arguments.no_signing,
    )
    with api_server(arguments) as api:
        return OK if renew(api, release, datetime.now(UTC), built()) else NO


def renew(api: ApiServer, release: Release, now: datetime, built: datetime) -> bool:
    """Each Secret is written only as it was read: of two who renew at once one fails, and tries again.

    Returns whether all are good now. Who may edit a robot's namespace may delete its Secrets and fill them as they
    like: what is wrong there is printed, keeps no other from being written, and says nothing about the time.
    """
    from contextpolicy.bus.renewal import due, moment

    places = release.places()
    own = {place: api.secret(place.namespace, place.name) for place in places if place.namespace == release.namespace}
    shared = _readable(api, (place for place in places if place not in own))
    found = own | shared
    files = {place: secret.files for place, secret in found.items()}
    time = moment(release, {place: files[place] for place in own}, now, built)
    if time != now:
        print(f"the clock shows {now:%F}, which must be wrong: nothing is renewed, and {time:%F} is used instead")
    changes = {place: content for place, content in due(release, files, time).items() if place in found}
    failed = len(places) - len(found)
    for place, content in sorted(changes.items(), key=lambda change: change[0] in shared):
        try:
            api.write_secret(place.namespace, place.name, content, found[place].version)
        except ActuationError as error:
            if place in own:
                raise
            failed += 1
            _complain(place, error)
        else:
            print(f"{place.namespace}/{place.name}: written")
    print(f"{len(found) - len(changes)} of {len(places)} Secrets need no change")
    return not failed


def _readable(api: ApiServer, places: Iterable[Place]) -> dict[Place, Secret]:
    found = {}
    for place in places:
        try:
            found[place] = api.secret(place.namespace, place.name)
        except (ActuationError, ValueError) as error:
            _complain(place, error)
    return found


def _complain(place: Place, error: Exception) -> None:
    remedy = (
        "if it exists, delete it and upgrade, which creates it again; or remove its namespace from security.namespaces"
    )
    print(f"{place.namespace}/{place.name}: NOT written: {error}; {remedy}", file=sys.stderr)


def built() -> datetime:
    """When this program was built: no clock that is right says less."""
    from datetime import UTC, datetime

    return datetime.fromtimestamp(Path(__file__).stat().st_mtime, UTC)
