"""`contextpolicy restore`: restores every container to what it was before any policy, when no operator runs."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.commands.cluster_access import add_cluster, api_server
from contextpolicy.commands.exit_codes import FAILED, NO
from contextpolicy.commands.structured_output import add_output, structured
from contextpolicy.commands.terminal import waiting
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Collection, Iterator, Sequence

    from contextpolicy.actuators.resize.offline_release import Released
    from contextpolicy.actuators.resize.offline_restore import LeftAlone, RestoreApi, Restored, Unread
    from contextpolicy.cluster.occupancy import Occupancy
    from contextpolicy.cluster.originals_key import SecretApi
    from contextpolicy.cluster.pods import Cpu

    class CommandApi(RestoreApi, SecretApi, Protocol):
        """The calls to the API server that the command needs."""

        def delete_secret(self, namespace: str, name: str) -> None:
            """Delete a Secret."""


NEEDED = "hold originals signed with it, in namespaces that another release serves"


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "restore",
        help="restore containers when there is no operator",
        description="Restore every container that a policy resized. Use it when the operator is gone: a running "
        "operator would resize them again, so namespaces that an operator serves are left alone.",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("-n", "--namespace", metavar="NS", action="append", help="only in this namespace; repeatable")
    where.add_argument("-A", "--all-namespaces", action="store_true", help="in every namespace (default)")
    parser.add_argument(
        "--remove-finalizers",
        action="store_true",
        help="then remove the policies' finalizers, so that they can be deleted without an operator",
    )
    parser.add_argument(
        "--release",
        metavar="NS/NAME",
        default="",
        help="act for this release alone: skip namespaces whose Lease names another release, even one that is down, "
        "and believe only originals that this release's operator signed (default: skip namespaces whose Lease was "
        "renewed in the last 60 s)",
    )
    parser.add_argument("--dry-run", action="store_true", help="only print what would be done")
    add_cluster(parser)
    add_output(parser)
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Restore, and print what was done."""
    with api_server(arguments) as api, waiting("restoring, and waiting for operators that may still act"):
        return run(api, arguments)


def run(api: CommandApi, arguments: argparse.Namespace) -> int:
    """Restore containers first: a policy keeps its finalizer while one that it resized is not back.

    Its status has the only record of what that container had.
    """
    from contextpolicy.actuators.resize.offline_restore import settle
    from contextpolicy.cluster.occupancy import Occupancy

    dry_run: bool = arguments.dry_run
    namespaces: Sequence[str | None] = arguments.namespace or [None]
    occupancy = Occupancy(api, arguments.release, time.sleep, dry_run=dry_run)
    key = _key(api, arguments.release)
    settle(api, namespaces, occupancy)
    restored, left, unread = _restore(api, namespaces, occupancy, key, dry_run=dry_run)
    whole = [one for one in unread if one.namespace in namespaces]
    if len(whole) == len(namespaces):
        raise whole[0].error
    released: Sequence[Released] = ()
    if arguments.remove_finalizers:
        closed = {one.namespace for one in whole}
        readable = [where for where in namespaces if where not in closed]
        held = {one.policy for one in restored if one.error} | {one.namespace for one in left}
        held |= {one.namespace for one in unread if one.namespace}
        released = _release(api, readable, occupancy, key, held, dry_run=dry_run)
    _print(arguments.output, restored, left, released, unread)
    if dry_run:
        print("dry run: nothing was changed", file=sys.stderr)
    code = _exit_code(restored, released, unread)
    if code == 0 and arguments.remove_finalizers and not dry_run:
        _finish(api, arguments, occupancy, key, {one.namespace for one in left})
    return code


def _restore(
    api: CommandApi, namespaces: Sequence[str | None], occupancy: Occupancy, key: bytes | None, *, dry_run: bool
) -> tuple[list[Restored], list[LeftAlone], list[Unread]]:
    """What became of each container, and the namespaces that were left alone or can't be read."""
    from contextpolicy.actuators.resize import offline_restore
    from contextpolicy.actuators.resize.offline_restore import LeftAlone, Restored, Unread
    from contextpolicy.actuators.resize.stored_originals import signatures_with

    done = [
        one
        for where in namespaces
        for one in offline_restore.restore(api, where, occupancy, signatures_with(key), dry_run=dry_run)
    ]
    restored = [one for one in done if isinstance(one, Restored)]
    left = [one for one in done if isinstance(one, LeftAlone)]
    unread = [one for one in done if isinstance(one, Unread)]
    return restored, left, unread


def _release(  # noqa: PLR0913 - as `release`
    api: CommandApi,
    namespaces: Sequence[str | None],
    occupancy: Occupancy,
    key: bytes | None,
    held: Collection[str],
    *,
    dry_run: bool,
) -> list[Released]:
    """Remove the finalizers of the policies that have no container left to restore."""
    from contextpolicy.actuators.resize.offline_release import release
    from contextpolicy.actuators.resize.stored_originals import signatures_with

    signatures = signatures_with(key)
    return [one for where in namespaces for one in release(api, where, occupancy, signatures, held, dry_run=dry_run)]


def _exit_code(restored: Sequence[Restored], released: Sequence[Released], unread: Sequence[Unread]) -> int:
    if unread:
        return FAILED
    return NO if any([*(one.error for one in restored), *(one.error for one in released)]) else 0


def _key(api: CommandApi, release: str) -> bytes | None:
    """The key with which the release signed originals; without it every original in a status is trusted."""
    from contextpolicy.cluster.originals_key import find_key, secret_of

    if not release:
        return None
    try:
        key = find_key(api, *secret_of(release))
    except ActuationError as error:
        print(f"originals are not checked: {error}", file=sys.stderr)
        return None
    if key is None:
        print(f"originals are not checked: {release} has no key", file=sys.stderr)
    return key


def _finish(
    api: CommandApi, arguments: argparse.Namespace, occupancy: Occupancy, key: bytes | None, left: Collection[str]
) -> None:
    """Remove the rest of the release: its Leases, and its key unless namespaces that others serve still need it."""
    from contextpolicy.actuators.resize.offline_release import in_need
    from contextpolicy.actuators.resize.stored_originals import Signatures
    from contextpolicy.cluster.originals_key import secret_of

    release, namespaces = arguments.release, arguments.namespace or [None]
    try:
        if key is not None:
            own = Signatures(key)
            needed = sorted(policy for where in namespaces for policy in in_need(api, where, left, own))
            if needed:
                print(f"Secret {'/'.join(secret_of(release))} is kept: {', '.join(needed)} {NEEDED}", file=sys.stderr)
            else:
                api.delete_secret(*secret_of(release))
        occupancy.give_back()
    except ActuationError as error:
        print(f"{release} could not be removed completely: {error}", file=sys.stderr)


def _print(
    output: str,
    restored: Sequence[Restored],
    left: Sequence[LeftAlone],
    released: Sequence[Released],
    unread: Sequence[Unread],
) -> None:
    if output == "table":
        _print_text(restored, left, released)
    else:
        print(structured(_document(restored, left, released, unread), output))
    for one in unread:
        print(f"namespace {one.namespace}: NOT read: {one.error.reason}: {one.error}", file=sys.stderr)


def _print_text(restored: Sequence[Restored], left: Sequence[LeftAlone], released: Sequence[Released]) -> None:
    for one in left:
        print(f"namespace {one.namespace}: served by {one.holder}, left alone")
    for container in restored:
        print(f"{container.container}: {_deed(container)}")
    for policy in released:
        deed = f"NOT released: {policy.error}" if policy.error else "finalizer removed"
        print(f"ContextPolicy {policy.policy}: {deed}")
    if not (restored or left or released):
        print("nothing to restore")


def _deed(container: Restored) -> str:
    if container.error:
        return f"NOT restored: {container.error}"
    if container.note:
        return f"left as it is: {container.note}"
    changes = [f"{kind} {old} -> {new}" for kind, old, new in _differences(container.moved, container.original)]
    return ", ".join(changes) or "already restored"


def _differences(moved: Cpu | None, original: Cpu | None) -> Iterator[tuple[str, str, str]]:
    old, new = _quantities(moved), _quantities(original)
    for kind in new:
        if old.get(kind) != new[kind]:
            yield kind, old.get(kind, "-"), new[kind]


def _quantities(cpu: Cpu | None) -> dict[str, str]:
    from contextpolicy.policy.quantities import format_cpu

    amounts = {"limit": cpu.limit, "request": cpu.request} if cpu else {}
    return {kind: format_cpu(amount) for kind, amount in amounts.items() if amount is not None}


def _document(
    restored: Sequence[Restored], left: Sequence[LeftAlone], released: Sequence[Released], unread: Sequence[Unread]
) -> dict[str, Any]:
    containers = [
        {
            "container": one.container,
            "policy": one.policy,
            "moved": _quantities(one.moved),
            "original": _quantities(one.original),
            "error": one.error,
            "note": one.note,
        }
        for one in restored
    ]
    policies = [{"policy": one.policy, "error": one.error} for one in released]
    alone = [{"namespace": one.namespace, "servedBy": one.holder} for one in left]
    closed = [{"namespace": one.namespace, "error": f"{one.error.reason}: {one.error}"} for one in unread]
    return {"containers": containers, "policies": policies, "leftAlone": alone, "unread": closed}
