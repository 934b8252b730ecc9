"""The options that describe a simulated robot, the same for every command that simulates."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from contextpolicy.commands.validate import add_types_argument
from contextpolicy.errors import Finding, SettingsError
from contextpolicy.policy.quantities import CPU_ALLOWED, parse_cpu
from contextpolicy.policy.suggestions import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from contextpolicy.policy.spec import Policy
    from contextpolicy.simulation.robot import Robot

MAX_CORES = 1024
MAX_REPLICAS = 100
MAX_SECONDS = 10**7
MAX_RATE = 1000


def add(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    add_types_argument(parser)
    parser.add_argument(
        "--rate",
        type=rate,
        default=1.0,
        metavar="R",
        help="replay inputs R times as fast, as for a robot with 1/R of the CPU speed (default: 1)",
    )
    own = parser.add_argument_group(
        "robot", "Each task runs once, on the first node, with no CPU request, unless said otherwise."
    )
    own.add_argument(
        "--cores", type=_cpu, metavar="CPU", help="cores of the one node: 4 or 500m (default: 4, a Raspberry Pi)"
    )
    own.add_argument(
        "--node", type=_named_cpu, action="append", metavar="NAME=CPU", help="a node and its cores; repeatable"
    )
    own.add_argument(
        "--place",
        type=_named,
        action="append",
        metavar="TASK=NODE",
        help="the node of a task; repeatable, also for one task",
    )
    own.add_argument(
        "--replicas",
        type=_named_count,
        action="append",
        metavar="TASK=COUNT",
        help="how many pods a task has, over its nodes",
    )
    own.add_argument(
        "--request", type=_named_cpu, action="append", metavar="TASK=CPU", help="the CPU request of a task's container"
    )
    own.add_argument(
        "--no-realtime",
        action="append",
        nargs="?",
        const="",
        metavar="NODE",
        help="simulate a node (default: every node) that can't do realtime: enforcement.realtimeFallback decides",
    )


def robot_of(arguments: argparse.Namespace, policy: Policy) -> Robot:
    """The robot; SettingsError names all unknown tasks and nodes at once."""
    from contextpolicy.simulation.robot import CORES, NODE, Robot

    nodes = dict(arguments.node or [(NODE, arguments.cores or CORES)])
    places: dict[str, tuple[str, ...]] = {}
    for task, node in arguments.place or ():
        places[task] = (*places.get(task, ()), node)
    unable = arguments.no_realtime or []
    findings = [
        *_unknown("--place", places, [task.name for task in policy.leaves]),
        *_unknown("--place", [node for on in places.values() for node in on], nodes),
        *_unknown("--replicas", dict(arguments.replicas or ()), [task.name for task in policy.leaves]),
        *_unknown("--request", dict(arguments.request or ()), [task.name for task in policy.leaves]),
        *_unknown("--no-realtime", filter(None, unable), nodes),
    ]
    if arguments.node and arguments.cores:
        findings.append(Finding("--cores", arguments.cores, "either --cores or --node, not both"))
    if findings:
        raise SettingsError("arguments", tuple(findings))
    return Robot(
        nodes=nodes,
        places=places,
        replicas=dict(arguments.replicas or ()),
        requests=dict(arguments.request or ()),
        fair_only=frozenset(nodes if "" in unable else unable),
    )


def seconds(text: str) -> float:
    """A point in time, in seconds."""
    value = _number(text)
    if not 0 <= value <= MAX_SECONDS:
        raise argparse.ArgumentTypeError(
            f"invalid value {text!r}: expected a number of seconds from 0 to {MAX_SECONDS}"
        )
    return value


def rate(text: str) -> float:
    """How many times as fast."""
    value = _number(text)
    if not 1 / MAX_RATE <= value <= MAX_RATE:
        raise argparse.ArgumentTypeError(
            f"invalid value {text!r}: expected a factor from {1 / MAX_RATE:g} to {MAX_RATE}"
        )
    return value


def _unknown(option: str, names: Iterable[str], known: Collection[str]) -> list[Finding]:
    allowed = "one of " + ", ".join(known)
    return [Finding(option, name, allowed + did_you_mean(name, known)) for name in names if name not in known]


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return -1.0  # out of range: the caller refuses it with the right words


def _cpu(text: str) -> int:
    try:
        value = parse_cpu(text)
    except ValueError:
        value = 0
    if not 0 < value <= MAX_CORES * 1000:
        raise argparse.ArgumentTypeError(
            f"invalid value {text!r}: expected {CPU_ALLOWED}, above 0 and at most {MAX_CORES}"
        )
    return value


def _named(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected NAME=VALUE")
    return name, value


def _named_cpu(text: str) -> tuple[str, int]:
    name, value = _named(text)
    return name, _cpu(value)


def _named_count(text: str) -> tuple[str, int]:
    name, value = _named(text)
    if not value.isdecimal() or not 0 < int(value) <= MAX_REPLICAS:
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected an integer from 1 to {MAX_REPLICAS}")
    return name, int(value)
