"""`contextpolicy record`: the last minutes of a policy on the robot, as files that `simulate` replays offline."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contextpolicy.commands.cluster_access import ClusterAccessError, add_namespace, api_server, reference_of
from contextpolicy.commands.operator_access import operator
from contextpolicy.commands.robot_arguments import seconds

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator, Mapping

    from contextpolicy.simulation.robot import Robot


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "record",
        help="save the last minutes of a policy, to be replayed",
        description="Save what the operator's flight recorder holds of a policy, up to five minutes: timeline.json "
        "(its samples, for `simulate` and `explain`), policy.yaml, and plans.jsonl (what was decided, one plan a "
        "line). Prints the command that replays it.",
    )
    parser.add_argument("policy", metavar="POLICY", help="[NAMESPACE/]NAME")
    parser.add_argument("--to", type=Path, metavar="DIR", help="a new folder (default: NAME-recorded)")
    parser.add_argument("--last", type=seconds, metavar="S", default=300.0, help="how many seconds back (default: 300)")
    add_namespace(parser)
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Ask and write."""
    namespace, name = reference_of(arguments)
    folder: Path = arguments.to or Path(f"{name}-recorded")
    if folder.exists():
        raise ClusterAccessError(f"--to: invalid value {str(folder)!r}: expected a folder that does not exist yet")
    with api_server(arguments) as api, operator(api, arguments, namespace) as ask:
        recorded = ask("recording", policy=f"{namespace}/{name}", last=arguments.last)
    if recorded is None:
        raise ClusterAccessError(
            f"the operator runs no policy {namespace}/{name}: `status -A` lists all policies, and what is wrong"
        )
    if not recorded["timeline"]["inputs"]:
        raise ClusterAccessError(
            f"no samples for {namespace}/{name} yet, so there is nothing to replay; `top` shows its streams"
        )
    for path, text in contents(recorded).items():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")
    inputs, plans = recorded["timeline"]["inputs"], recorded["plans"]
    print(f"{folder}: {recorded['timeline']['duration']:.1f} s, {len(inputs)} samples, {len(plans)} plans")
    print(f"contextpolicy simulate {folder}/policy.yaml {folder}/timeline.json {' '.join(robot(recorded))}".rstrip())
    return 0


def contents(recorded: Mapping[str, Any]) -> dict[str, str]:
    """The files by name."""
    import yaml

    return {
        "timeline.json": json.dumps(recorded["timeline"], indent=1) + "\n",
        "policy.yaml": yaml.safe_dump(recorded["policy"], sort_keys=False, allow_unicode=True),
        "plans.jsonl": "".join(f"{json.dumps(plan)}\n" for plan in recorded["plans"]),
    }


def robot(recorded: Mapping[str, Any]) -> Iterator[str]:
    """The arguments that describe the robot as its last plan saw it."""
    if not recorded["plans"]:
        return
    from contextpolicy.policy.quantities import parse_cpu

    seen = robot_of(recorded["plans"][-1], parse_cpu(str(recorded["policy"]["spec"].get("reserve", "0"))))
    yield from (f"--node {node}={cpu}m" for node, cpu in seen.nodes.items())
    yield from (f"--place {task}={node}" for task, nodes in seen.places.items() for node in nodes)


def robot_of(plan: Mapping[str, Any], reserve: int) -> Robot:
    """The robot that a plan describes; `reserve` is what its policy leaves of each node, in thousandths of a core."""
    from contextpolicy.simulation.robot import Robot

    # The capacity is what the reserve leaves.
    nodes = {node: round(made["capacity"] * 1000) + reserve for node, made in plan["nodes"].items()}
    places: dict[str, tuple[str, ...]] = {}
    for task, node in dict.fromkeys((target["task"], target["node"]) for target in plan["targets"]):
        places[task] = (*places.get(task, ()), node)
    return Robot(nodes, places if len(nodes) > 1 else {})
