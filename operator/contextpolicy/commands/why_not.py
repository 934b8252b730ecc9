"""`contextpolicy why-not`: why contexts do not hold."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.commands import explain
from contextpolicy.commands.cluster_access import ClusterAccessError
from contextpolicy.commands.structured_output import add_output, structured
from contextpolicy.commands.terminal import columns
from contextpolicy.explain.text_table import wrapped
from contextpolicy.policy.suggestions import did_you_mean

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator, Mapping


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "why-not",
        help="explain why a context does not hold",
        description="For each context that does not hold, or for one, show the decisive part of its condition and "
        "what it waits for. `explain` shows this and more.",
    )
    parser.add_argument("policy", metavar="POLICY", help="[NAMESPACE/]NAME; with --timeline a policy file")
    parser.add_argument("context", metavar="CONTEXT", nargs="?", help="one context (default: all that do not hold)")
    explain.add_source(parser)
    add_output(parser)
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Get the explanation and print that part."""
    explanation = explain.explanation_of(arguments)
    known = list(explanation["contexts"])
    if arguments.context and arguments.context not in known:
        allowed = ("expected one of " + ", ".join(known) if known else "the policy has none") + did_you_mean(
            arguments.context, known
        )
        raise ClusterAccessError(f"unknown context {arguments.context!r}: {allowed}")
    sentences = dict(_sentences(explanation))
    chosen = [arguments.context] if arguments.context else [name for name in known if not holds(explanation, name)]
    if arguments.output == "table":
        for sentence in [sentences[name] for name in chosen] or ["all contexts hold"]:
            print(*wrapped(sentence, columns(), "", "  "), sep="\n")
    else:
        contexts = {name: {**explanation["contexts"][name], "sentence": sentences[name]} for name in chosen}
        print(structured({"policy": explanation["policy"], "contexts": contexts}, arguments.output))
    return 1 if arguments.context and holds(explanation, arguments.context) else 0


def holds(explanation: Mapping[str, Any], name: str) -> bool:
    """Whether the context has effects."""
    return bool(explanation["contexts"][name]["active"])


def _sentences(explanation: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    from contextpolicy.explain.sentences import context_sentences

    return zip(explanation["contexts"], context_sentences(explanation), strict=True)
