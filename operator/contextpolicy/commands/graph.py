"""`contextpolicy graph`: the policy's task graph as Mermaid text or as a picture."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "graph",
        help="draw the task graph of a policy",
        description="Draw streams, tasks with their subtasks, pre-conditions and needs, and what contexts change.",
    )
    parser.add_argument("policy", metavar="POLICY", help="a file with one ContextPolicy")
    parser.add_argument(
        "-o",
        "--output",
        metavar="FORMAT",
        choices=("mermaid", "svg"),
        default="mermaid",
        help="mermaid (default) or svg; svg needs pip install '.[plot]' in a checkout",
    )
    parser.add_argument("--context", metavar="NAME", help="show the graph as this context modifies it")
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Print the picture."""
    from contextpolicy.explain.graph_picture import svg
    from contextpolicy.explain.mermaid import mermaid
    from contextpolicy.explain.task_graph import build
    from contextpolicy.policy.validation.policy_file import load_policy

    policy = load_policy(arguments.policy)
    known = [context.name for context in policy.contexts]
    if arguments.context is not None and arguments.context not in known:
        allowed = f"expected one of {', '.join(known)}" if known else "the policy has none"
        print(f"--context: unknown context {arguments.context!r}: {allowed}", file=sys.stderr)
        return 2
    graph = build(policy, context=arguments.context)
    print(mermaid(graph) if arguments.output == "mermaid" else svg(graph))
    return 0
