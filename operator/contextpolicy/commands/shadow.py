"""`contextpolicy shadow`: what a shadow decides otherwise than its policy, and what that does to misses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.commands.cluster_access import (
    ClusterAccessError,
    add_namespace,
    api_server,
    policy_object,
    reference_of,
)
from contextpolicy.commands.operator_access import operator
from contextpolicy.commands.robot_arguments import seconds
from contextpolicy.commands.structured_output import add_output, structured
from contextpolicy.commands.terminal import columns, waiting
from contextpolicy.explain.text_table import text_table, wrapped

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from contextpolicy.shadow.difference import ShadowDifference

SHOWN = 20
"""Stretches of time that are listed, the newest; `--output json` has all."""


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "shadow",
        help="show where a shadow's plans differ from its policy's",
        description="Compare the plans of a shadow (spec.shadow) with those of the policy that it shadows, over the "
        "last minutes that the operator has recorded, and show the misses that the tasks' modules report. With "
        "--profiles, replay the recording under both policies and predict the misses under each; inputs that neither "
        "policy reads are assumed to arrive as steadily as when the profile was measured.",
    )
    parser.add_argument("policy", metavar="SHADOW", help="[NAMESPACE/]NAME of the shadow")
    parser.add_argument("--last", type=seconds, metavar="S", default=300.0, help="how many seconds back (default: 300)")
    parser.add_argument("--profiles", metavar="FILE", help="predict misses from the tasks' profiles")
    add_namespace(parser)
    add_output(parser)
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Ask, compare and print."""
    namespace, name = reference_of(arguments)
    with api_server(arguments) as api, operator(api, arguments, namespace) as ask:
        shadow = policy_object(api, namespace, name)
        own = policy_object(api, namespace, of(shadow))
        found = _compared(ask, own, shadow, arguments.last)
        with waiting("predicting"):
            predicted = [_misses(ask, body, arguments) for body in (own, shadow)] if arguments.profiles else [{}, {}]
    comparison = document(own, shadow, found, predicted)
    print(structured(comparison, arguments.output) if arguments.output != "table" else "\n".join(lines(comparison)))
    return 0


def of(shadow: Mapping[str, Any]) -> str:
    """The name of the policy that this one is a shadow of; ClusterAccessError if it is none."""
    name = (shadow["spec"].get("shadow") or {}).get("of")
    if name is None:
        metadata = shadow["metadata"]
        raise ClusterAccessError(f"{metadata['namespace']}/{metadata['name']} is not a shadow: it has no spec.shadow")
    return str(name)


def _compared(
    ask: Callable[..., Any], own: Mapping[str, Any], shadow: Mapping[str, Any], last: float
) -> ShadowDifference:
    from contextpolicy.shadow.difference import difference

    boards = {board["policy"]: board for board in ask("boards")}
    references = [f"{body['metadata']['namespace']}/{body['metadata']['name']}" for body in (own, shadow)]
    for reference in references:
        if reference not in boards:
            raise ClusterAccessError(f"the operator runs no policy {reference}: `status` shows why")
    now = boards[references[1]]["now"]
    plans = [ask("plans", policy=reference, since=0) for reference in references]
    found = difference(plans[0], plans[1], now - last, now)
    if found is None:
        raise ClusterAccessError(
            f"{' and '.join(references)} can't be compared yet: one has no plan, `status` shows why"
        )
    return found


def _misses(ask: Callable[..., Any], body: Mapping[str, Any], arguments: argparse.Namespace) -> dict[str, float]:
    """The predicted misses of each profiled task, if this policy had decided on what was recorded of it."""
    from contextpolicy.commands.record import robot_of
    from contextpolicy.policies import plugins
    from contextpolicy.policy.parsing import parse
    from contextpolicy.simulation.forecast import ALL, forecast
    from contextpolicy.simulation.profiles import load_profiles, with_steady_inputs
    from contextpolicy.simulation.run import simulate
    from contextpolicy.streams import timeline

    policy, profiles = parse(body), load_profiles(arguments.profiles)
    recorded = ask("recording", policy=policy.reference, last=arguments.last)
    inputs = with_steady_inputs(timeline.parse(recorded["timeline"]), profiles)
    robot = robot_of(recorded["plans"][-1], policy.reserve)
    run = simulate(policy, inputs, robot=robot, initiatives=plugins.load(policy))
    predicted = forecast(policy, inputs, run.plans, profiles, until=run.until)
    return {task: own[ALL].misses for task, own in predicted.tasks.items() if ALL in own}


def document(
    own: Mapping[str, Any], shadow: Mapping[str, Any], found: ShadowDifference, predicted: Sequence[Mapping[str, float]]
) -> dict[str, Any]:
    """All that is shown, as JSON fields; pairs are of policy and shadow, `from` and `to` in seconds before now."""
    status = (shadow.get("status") or {}).get("shadow") or {}
    measured = {task["name"]: task for task in status.get("tasks") or ()}
    promoted = (own.get("status") or {}).get("promotedShadow") == shadow["metadata"]["name"]
    return {
        "shadow": f"{shadow['metadata']['namespace']}/{shadow['metadata']['name']}",
        "of": f"{own['metadata']['namespace']}/{own['metadata']['name']}",
        "promoted": promoted,
        "reverted": (status.get("reverted") or {}).get("message"),
        "seconds": round(found.end - found.start, 3),
        "differs": round(found.part, 4),
        "tasks": {
            name: {
                "share": [round(share, 3) for share in task.share],
                "suspended": [round(part, 4) for part in task.suspended],
                "misses": [measured.get(name, {}).get(which) for which in ("missesBefore", "misses")],
                "predictedMisses": [misses.get(name) for misses in predicted],
            }
            for name, task in found.tasks.items()
        },
        "stretches": [
            {
                "from": round(found.end - stretch.start, 3),
                "to": round(found.end - stretch.end, 3),
                "contexts": [list(names) for names in stretch.contexts],
                "shares": {task: list(shares) for task, shares in stretch.shares.items()},
            }
            for stretch in found.stretches
        ],
    }


def lines(comparison: Mapping[str, Any]) -> Iterator[str]:
    """The document for people."""
    how = "promoted in place of" if comparison["promoted"] else "beside"
    differs = f"{comparison['seconds']:.0f} s: other shares {comparison['differs']:.0%} of the time"
    yield from wrapped(f"{comparison['shadow']} {how} {comparison['of']}, {differs}", columns(), others="  ")
    if comparison["reverted"]:
        yield from wrapped(f"its last promotion was reverted: {comparison['reverted']}", columns(), "  ", "    ")
    task_head = ("TASK", "MEAN SHARE", "SUSPENDED", "MISSES, MEASURED", "MISSES, PREDICTED")
    rows = [_row(name, task) for name, task in comparison["tasks"].items()]
    yield from text_table(task_head, rows, columns(), indent="  ")
    shown = comparison["stretches"][-SHOWN:]
    stretch_head = ("SECONDS AGO", "CONTEXTS", "SHARES")
    yield from text_table(stretch_head, [_stretch(one) for one in shown], columns(), indent="  ")
    if len(comparison["stretches"]) > len(shown):
        yield f"  and {len(comparison['stretches']) - len(shown)} earlier ones"


def _row(name: str, task: Mapping[str, Any]) -> tuple[str, ...]:
    parts = (_arrow(*map(_part, task[field])) for field in ("suspended", "misses", "predictedMisses"))
    return name, _arrow(*map(_cpu, task["share"])), *parts


def _stretch(comparison: Mapping[str, Any]) -> tuple[str, ...]:
    shares = (f"{task} {_arrow(*map(_cpu, both))}" for task, both in comparison["shares"].items())
    return (
        f"{comparison['from']:.1f} to {comparison['to']:.1f}",
        _arrow(*map(_names, comparison["contexts"])),
        ", ".join(shares),
    )


def _arrow(one: str, other: str) -> str:
    return one if one == other else f"{one} -> {other}"


def _cpu(cores: float) -> str:
    return f"{cores * 1000:.0f}m"


def _part(part: float | None) -> str:
    return "-" if part is None else f"{part:.1%}"


def _names(contexts: Sequence[str]) -> str:
    return ", ".join(contexts) or "-"
