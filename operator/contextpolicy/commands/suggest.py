"""`contextpolicy suggest`: weights, bounds and delays that meet the tasks' deadlines, found in the simulation."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING, Any

from contextpolicy.commands import recording_arguments, robot_arguments
from contextpolicy.commands.simulate import progress
from contextpolicy.errors import Finding, SettingsError
from contextpolicy.policy.quantities import parse_duration
from contextpolicy.policy.suggestions import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from contextpolicy.policy.spec import Policy
    from contextpolicy.simulation.forecast import Forecast
    from contextpolicy.simulation.knobs import Values
    from contextpolicy.simulation.search import Goal, SearchResult
    from contextpolicy.simulation.trial import Trial

DESCRIPTION = """\
Search weights, bounds and delays with which the tasks meet their deadlines on the given timelines, and print them as a
patch, with the predicted misses before and after. Only numbers are turned: priorities, idle scores, min and max, the
weights and scales of contexts, their delays, and holds. What is suspended when, all conditions and the order stay.

What comes out is a prediction (see `contextpolicy simulate --help`): try it with mode DryRun, then measure."""

DETAILS = """\
output (--output): text is a YAML file with the prediction in comments, ready for

  contextpolicy suggest POLICY TIMELINE ... --profiles FILE > patch.yaml
  kubectl patch contextpolicy NAME --type json --patch-file patch.yaml

json has the fields before, after (cost, and the statistics by task and context for each timeline), tries and patch.

A task's deadline is that of --deadline, or the policy's needs.deadline, or the one in its profile; a task without a
deadline must only drop nothing. The cost is the mean of the tasks' misses, weighted by priority; misses above --misses
count a hundredfold, and inputs that are suspended only with the patch count as missed. A plan a second costs 0.01.

exit codes: 0 every task meets its goal with the patch (or without one), 1 not every one does, 2 it could not run"""
MISSES = 0.01
TRIES = 100


def add(subparsers: Any) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "suggest",
        help="search weights, bounds and delays that meet the deadlines",
        description=DESCRIPTION,
        epilog=DETAILS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("policy", metavar="POLICY", help="a file with one ContextPolicy")
    parser.add_argument("timelines", metavar="TIMELINE", nargs="+", help="timelines or recordings")
    parser.add_argument("--profiles", metavar="FILE", required=True, help="what the tasks cost, from robotkit.profiles")
    parser.add_argument(
        "--deadline", type=_task_time, action="append", metavar="TASK=TIME", help="from an input to its result: 100ms"
    )
    parser.add_argument(
        "--priority", type=_task_number, action="append", metavar="TASK=N", help="how much misses matter (the policy's)"
    )
    parser.add_argument(
        "--misses", type=_part, default=MISSES, metavar="PART", help="of the inputs that are allowed (default: 0.01)"
    )
    parser.add_argument(
        "--tries", type=_count, default=TRIES, metavar="N", help="policies to simulate at most (default: 100)"
    )
    robot_arguments.add(parser)
    recording_arguments.add(parser)
    parser.add_argument("--output", choices=("text", "json"), default="text", help="default: text")
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Search, and print the patch with the prediction."""
    from contextpolicy.simulation.knobs import knobs, patch
    from contextpolicy.simulation.search import cost, search
    from contextpolicy.simulation.trial import demand

    trial = _trial(arguments)
    before = trial.predict({}) or []
    goals = _goals(arguments, trial)

    def judge(values: Values) -> float:
        predicted = trial.predict(values) if values else before
        return math.inf if predicted is None else cost(predicted, before, goals)

    with progress(arguments.tries, "searching") as tell:
        listed = knobs(trial.resource, demand(before, trial.timelines))
        found = search(listed, _counted(judge, tell), arguments.tries)
    after = trial.predict(found.values) or before
    names = [timeline.name for timeline in trial.timelines]
    answer = Suggestion(found, list(zip(names, before, after, strict=True)), patch(trial.resource, found.values))
    print(answer.as_json() if arguments.output == "json" else answer.as_text())
    missed = sorted({task for one in after for task in _above(one, goals)})
    for task in missed:
        print(f"note: {task} misses more than {arguments.misses:g} of its inputs all the same", file=sys.stderr)
    return 1 if missed else 0


@dataclass(frozen=True, slots=True)
class Suggestion:
    """What was found, the name and both predictions of each timeline, and the patch."""

    found: SearchResult
    forecasts: list[tuple[str, Forecast, Forecast]]
    patch: list[dict[str, Any]]

    def as_text(self) -> str:
        """A YAML file: the patch, with the prediction in comments."""
        from contextpolicy.simulation.forecast_report import as_table

        lines = [
            f"predicted, {self.found.tries} policies tried: cost {self.found.before:.4g} -> {self.found.after:.4g}"
        ]
        for name, before, after in self.forecasts:
            lines += ["", f"{name}, as it is:", *as_table(before).splitlines()]
            lines += ["", f"{name}, with the patch:", *as_table(after).splitlines()] if self.patch else []
        comments = "\n".join(f"# {line}".rstrip() for line in lines)
        return f"{comments}\n" + ("\n".join(f"- {json.dumps(change)}" for change in self.patch) or "[]")

    def as_json(self) -> str:
        """The same as fields."""
        from contextpolicy.simulation.forecast_report import as_fields

        parts = {
            name: {"cost": cost, "timelines": {title: as_fields(pair[index]) for title, *pair in self.forecasts}}
            for index, (name, cost) in enumerate((("before", self.found.before), ("after", self.found.after)))
        }
        return json.dumps({**parts, "tries": self.found.tries, "patch": self.patch}, indent=2)


def _trial(arguments: argparse.Namespace) -> Trial:
    from contextpolicy.policies import plugins
    from contextpolicy.policy.definition_files import of_folder
    from contextpolicy.policy.validation.policy_file import load_policy, load_resource
    from contextpolicy.simulation.profiles import load_profiles
    from contextpolicy.simulation.trial import Trial

    types = of_folder(arguments.types) if arguments.types else None
    policy = load_policy(arguments.policy, types)
    timelines = [
        recording_arguments.load_inputs(
            argparse.Namespace(**{**vars(arguments), "timeline": path}), policy, types or ()
        )
        for path in arguments.timelines
    ]
    deadlines = dict(arguments.deadline or ())
    _refuse_unknown(policy, {"--deadline": deadlines, "--priority": dict(arguments.priority or ())})
    profiles, robot = load_profiles(arguments.profiles), robot_arguments.robot_of(arguments, policy)
    resource = load_resource(arguments.policy)
    return Trial(resource, policy, timelines, profiles, robot, plugins.load(policy), deadlines)


def _goals(arguments: argparse.Namespace, trial: Trial) -> dict[str, Goal]:
    """Of every task with a profile: its priority (the policy's, or the one given), and the misses that are allowed."""
    from contextpolicy.simulation.search import Goal

    given = dict(arguments.priority or ())
    own = {task.name: given.get(task.name, task.priority) for task in trial.policy.leaves}
    return {name: Goal(own[name], arguments.misses) for name in trial.profiles.tasks if name in own}


def _above(predicted: Forecast, goals: Mapping[str, Goal]) -> Iterator[str]:
    from contextpolicy.simulation.forecast import ALL

    for task, goal in goals.items():
        stats = predicted.tasks.get(task, {}).get(ALL)
        if stats is not None and stats.misses > goal.misses:
            yield task


def _counted(judge: Callable[[Values], float], tell: Callable[[float], None] | None) -> Callable[[Values], float]:
    """The same judge, that tells how often it was asked."""
    tries = count(1)

    def counting(values: Values) -> float:
        if tell is not None:
            tell(next(tries))
        return judge(values)

    return counting


def _refuse_unknown(policy: Policy, given: Mapping[str, Mapping[str, float]]) -> None:
    known = [task.name for task in policy.leaves]
    findings = [
        Finding(option, name, "one of " + ", ".join(known) + did_you_mean(name, known))
        for option, named in given.items()
        for name in named
        if name not in known
    ]
    if findings:
        raise SettingsError("arguments", tuple(findings))


def _task_time(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, parse_duration(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text} is not allowed: TASK=TIME, such as slam=100ms") from None


def _task_number(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    return name, _number(value, text, "TASK=N, N of 0 or more", most=1e9)


def _part(text: str) -> float:
    return _number(text, text, "a part, 0 to 1", most=1.0)


def _count(text: str) -> int:
    return int(_number(text, text, "1 to 100000", most=100_000, least=1))


def _number(text: str, shown: str, allowed: str, *, most: float, least: float = 0) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"{shown} is not allowed: {allowed}")
    return value
