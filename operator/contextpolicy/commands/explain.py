"""`contextpolicy explain`: why a task has the share it has, live or at a moment of a simulation."""

from __future__ import annotations

import json
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contextpolicy.commands import recording_arguments, robot_arguments
from contextpolicy.commands.bus_arguments import add_credentials, connect
from contextpolicy.commands.cluster_access import add_namespace, api_server, policy_object, reference_of
from contextpolicy.commands.operator_access import operator
from contextpolicy.commands.robot_arguments import seconds
from contextpolicy.commands.simulate import read_files, run_policy
from contextpolicy.commands.structured_output import add_output, structured
from contextpolicy.commands.terminal import columns, waiting
from contextpolicy.errors import ContextPolicyError
from contextpolicy.explain.text_table import wrapped

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    import zenoh

PATIENCE = 3.0
"""Seconds to wait for the router, and as long again for the operator to answer."""


class NoAnswerError(ContextPolicyError):
    """No reply on the bus."""


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "explain",
        help="explain why a task has its share",
        description="Explain in sentences why each task has its share: samples, score, pre-conditions, contexts, task "
        "graph, Eq. 1 or 2, bounds and needs. For activities and contexts that do not hold, show the decisive part of "
        "the condition and the stream that it waits for. Reads the running operator, or simulates up to "
        "one point in time.",
    )
    parser.add_argument("policy", metavar="POLICY", help="[NAMESPACE/]NAME; with --timeline a policy file")
    parser.add_argument("task", metavar="TASK", nargs="?", help="one task (default: all)")
    add_source(parser)
    add_output(parser)
    parser.set_defaults(main=main)


def add_source(parser: argparse.ArgumentParser) -> None:
    """Declare where an explanation comes from: the cluster, the bus, or a simulation."""
    add_namespace(parser)
    source = parser.add_mutually_exclusive_group()
    source.add_argument(
        "--timeline", metavar="FILE", help="simulate this timeline or recording instead of asking the operator"
    )
    source.add_argument(
        "--connect",
        type=connect,
        metavar="ENDPOINTS",
        help="ask through the router at tcp/HOST:7447 (default: through the cluster, with kubectl)",
    )
    add_credentials(parser)
    parser.add_argument("--at", type=seconds, metavar="S", help="with --timeline: at S seconds (default: its end)")
    robot_arguments.add(parser)
    recording_arguments.add(parser)


def explanation_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """The explanation from wherever the command line says."""
    if arguments.timeline:
        return _simulate(arguments)
    if arguments.connect:
        return _ask(arguments)
    _refuse_file(arguments.policy)
    namespace, name = reference_of(arguments)
    with api_server(arguments) as api, operator(api, arguments, namespace) as ask:
        found: dict[str, Any] | None = ask("explanation", policy=f"{namespace}/{name}")
        if found is None:
            policy_object(api, namespace, name)
            raise NoAnswerError(f"the operator runs no valid version of {namespace}/{name}: see `status`")
    return found


def _refuse_file(policy: str) -> None:
    """Refuse a file name in place of a policy of the cluster, whose name can't have such an ending."""
    if policy.endswith((".yaml", ".yml", ".json")) or Path(policy).is_file():
        raise NoAnswerError(f"{policy} is a file: also pass --timeline with the samples to decide on")


def main(arguments: argparse.Namespace) -> int:
    """Get the explanation and print it."""
    from contextpolicy.explain.sentences import context_sentences, sentences
    from contextpolicy.policy.suggestions import did_you_mean

    explanation = explanation_of(arguments)
    known = list(explanation["tasks"])
    if arguments.task and known and arguments.task not in known:
        allowed = "one of " + ", ".join(known) + did_you_mean(arguments.task, known)
        print(f"unknown task {arguments.task!r}: expected {allowed}", file=sys.stderr)
        return 2
    if arguments.output != "table":
        print(structured(explanation, arguments.output))
        return 0
    for task in [arguments.task] if arguments.task else known or [""]:
        first, *others = sentences(explanation, task)
        _print(first)
        for sentence in others:
            _print(sentence, "  ")
    if not arguments.task:
        for sentence in context_sentences(explanation):
            _print(sentence)
    return 0


def _print(sentence: str, indent: str = "") -> None:
    print(*wrapped(sentence, columns(), indent, f"{indent}  "), sep="\n")


def _simulate(arguments: argparse.Namespace) -> dict[str, Any]:
    from contextpolicy.explain.explanation import explain

    policy, inputs = read_files(arguments)
    for note in inputs.notes:
        print(f"note: {note}", file=sys.stderr)
    robot = robot_arguments.robot_of(arguments, policy)
    run = run_policy(policy, inputs, robot=robot, until=arguments.at)
    return explain(run.planner, run.epoch + run.until)


def _ask(arguments: argparse.Namespace) -> dict[str, Any]:
    with visit(arguments.connect, arguments.credentials) as session:
        answer = _answer(session, f"contextpolicy/{'/'.join(reference_of(arguments))}/explain")
    if answer is not None:
        return answer
    raise NoAnswerError(
        f"no operator at {arguments.connect} answers for {arguments.policy}: check that it is running, and that the "
        "policy's NAMESPACE/NAME is right"
    )


@contextmanager
def visit(connect: str, credentials: Path | None = None) -> Iterator[zenoh.Session]:
    """A session on the robot's bus; NoAnswerError if no router answers in time, or it stops answering."""
    import zenoh

    from contextpolicy.bus.session import open_visitor, reason

    try:
        with ExitStack() as stack:
            with waiting(f"connecting to {connect}"):
                visitor = open_visitor(connect.split(","), patience=PATIENCE, credentials=credentials)
                session = stack.enter_context(visitor)
            yield session
    except zenoh.ZError as error:
        raise NoAnswerError(f"no Zenoh router answers at {connect}: {reason(error)}") from error


def _answer(session: zenoh.Session, key: str) -> dict[str, Any] | None:
    for reply in session.get(key, timeout=PATIENCE):
        if reply.ok is not None:
            answer: dict[str, Any] = json.loads(reply.ok.payload.to_bytes())
            return answer
    return None
