"""`contextpolicy why-not`: why contexts do not hold, or a task gets no more."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.commands import explain
from contextpolicy.commands.cluster_access import ClusterAccessError
from contextpolicy.policy.suggestions import did_you_mean

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator, Mapping


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "why-not",
        help="tell why a context does not hold",
        description="Of each context that does not hold, or of one, tell the part of its condition that decides and "
        "what it waits for: the part of `explain` about what is not the case. Exit code 1 if the named context holds.",
    )
    parser.add_argument("policy", metavar="POLICY", help="[NAMESPACE/]NAME; with --timeline a policy file")
    parser.add_argument("context", metavar="CONTEXT", nargs="?", help="one context (default: all that do not hold)")
    explain.add_source(parser)
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Get the explanation and print that part."""
    explanation = explain.explanation_of(arguments)
    known = list(explanation["contexts"])
    if arguments.context and arguments.context not in known:
        allowed = ("one of " + ", ".join(known) if known else "the policy has none") + did_you_mean(
            arguments.context, known
        )
        raise ClusterAccessError(f"context {arguments.context} is not allowed: {allowed}")
    told = dict(_told(explanation))
    chosen = [arguments.context] if arguments.context else [name for name in known if not holds(explanation, name)]
    print(*(told[name] for name in chosen) if chosen else ["all contexts hold"], sep="\n")
    return 1 if arguments.context and holds(explanation, arguments.context) else 0


def holds(explanation: Mapping[str, Any], name: str) -> bool:
    """Whether the context has effects."""
    return bool(explanation["contexts"][name]["active"])


def _told(explanation: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    from contextpolicy.explain.sentences import context_sentences

    return zip(explanation["contexts"], context_sentences(explanation), strict=True)
