"""`contextpolicy restore`: puts every container back as it was before any policy, when no operator runs."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator, Sequence

    from contextpolicy.actuators.resize.offline_restore import Released, RestoreApi, Restored
    from contextpolicy.cluster.pods import Cpu


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "restore",
        help="put containers back when there is no operator",
        description="Put every container that a policy resized back as it was. Use it when the operator "
        "is gone: a running one would resize them again. Exit codes: 0 all restored, 1 some are not: run it again.",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--namespace", metavar="NS", action="append", help="only in this namespace; may be repeated")
    where.add_argument("--all-namespaces", action="store_true", help="in every namespace (default)")
    parser.add_argument(
        "--remove-finalizers",
        action="store_true",
        help="then remove the policies' finalizers, which an absent operator can't, so that they can be deleted",
    )
    parser.add_argument("--dry-run", action="store_true", help="only print what would be done")
    parser.add_argument("--output", choices=("text", "json"), default="text", help="default: text")
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Restore, and print what was done."""
    from contextpolicy.cluster.api import ApiServer

    api = ApiServer()
    try:
        return run(api, arguments)
    finally:
        api.close()


def run(api: RestoreApi, arguments: argparse.Namespace) -> int:
    """Restore containers first: a policy keeps its finalizer while one that it resized is not back.

    Its status has the only record of what that container had.
    """
    from contextpolicy.actuators.resize import offline_restore

    namespaces: Sequence[str | None] = arguments.namespace or [None]
    dry_run: bool = arguments.dry_run
    restored = [one for where in namespaces for one in offline_restore.restore(api, where, dry_run=dry_run)]
    released: list[Released] = []
    if arguments.remove_finalizers:
        held = {one.policy for one in restored if one.error}
        released = [one for where in namespaces for one in offline_restore.release(api, where, held, dry_run=dry_run)]
    (_print_json if arguments.output == "json" else _print_text)(restored, released)
    if dry_run:
        print("dry run: nothing was changed", file=sys.stderr)
    errors = [*(one.error for one in restored), *(one.error for one in released)]
    return 1 if any(errors) else 0


def _print_text(restored: Sequence[Restored], released: Sequence[Released]) -> None:
    for container in restored:
        print(f"{container.container}: {_deed(container)}")
    for policy in released:
        deed = f"NOT released: {policy.error}" if policy.error else "finalizer removed"
        print(f"ContextPolicy {policy.policy}: {deed}")
    if not restored and not released:
        print("nothing to restore")


def _deed(container: Restored) -> str:
    if container.error:
        return f"NOT restored: {container.error}"
    changes = [f"{kind} {old} -> {new}" for kind, old, new in _differences(container.moved, container.original)]
    return ", ".join(changes) or "already as it was"


def _differences(moved: Cpu | None, original: Cpu | None) -> Iterator[tuple[str, str, str]]:
    old, new = _quantities(moved), _quantities(original)
    for kind in new:
        if old.get(kind) != new[kind]:
            yield kind, old.get(kind, "-"), new[kind]


def _quantities(cpu: Cpu | None) -> dict[str, str]:
    from contextpolicy.policy.quantities import format_cpu

    amounts = {"limit": cpu.limit, "request": cpu.request} if cpu else {}
    return {kind: format_cpu(amount) for kind, amount in amounts.items() if amount is not None}


def _print_json(restored: Sequence[Restored], released: Sequence[Released]) -> None:
    containers = [
        {
            "container": one.container,
            "policy": one.policy,
            "moved": _quantities(one.moved),
            "original": _quantities(one.original),
            "error": one.error,
        }
        for one in restored
    ]
    policies = [{"policy": one.policy, "error": one.error} for one in released]
    print(json.dumps({"containers": containers, "policies": policies}, indent=2))
