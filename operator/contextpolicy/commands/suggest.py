"""`contextpolicy suggest`: weights, bounds and delays that meet the tasks' deadlines, found in the simulation."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import dataclass, replace
from itertools import count
from typing import TYPE_CHECKING, Any

from contextpolicy.commands import recording_arguments, robot_arguments
from contextpolicy.commands.structured_output import add_output, structured
from contextpolicy.commands.terminal import columns, progress, waiting
from contextpolicy.errors import Finding, SettingsError
from contextpolicy.explain.text_table import wrapped
from contextpolicy.policy.quantities import parse_duration
from contextpolicy.policy.suggestions import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from contextpolicy.policy.spec import Policy
    from contextpolicy.simulation.forecast import Forecast
    from contextpolicy.simulation.knobs import Values
    from contextpolicy.simulation.profiles import Profiles
    from contextpolicy.simulation.search import Goal, SearchResult
    from contextpolicy.simulation.trial import Trial

DESCRIPTION = """\
Search for weights, bounds and delays with which the tasks meet their deadlines on the given timelines, and print them
as a patch, with the predicted misses before and after. Only numbers change: priorities, idle scores, min and max, the
weights and scales of contexts, and with --delays their delays and holds. Conditions, their order, and what is suspended
when stay the same. If all tasks already meet their goals there is no patch (with --delays, fewer plans justify one).

The result is a prediction (see `contextpolicy simulate --help`): try it with mode DryRun, then measure."""

DETAILS = """\
output (--output): text is a YAML file with the prediction in comments, ready for

  contextpolicy suggest POLICY TIMELINE ... --profiles FILE > patch.yaml
  kubectl patch contextpolicy NAME --type json --patch-file patch.yaml

json has the fields before, after (cost, and the statistics by task and context for each timeline), tries, caveats and
patch. A task without a profile is predicted to use no CPU, and the caveats name it: the others will lack what it uses.
Of floors (min) the least that suffices is taken, in steps of 10m.

A task's deadline is that of --deadline, or the policy's needs.deadline, or the one in its profile; a task without a
deadline only has to drop no inputs. The cost is the mean of the tasks' misses, weighted by priority; misses above
--misses count a hundredfold, and inputs that are suspended only with the patch count as missed. A plan a second
costs 0.01."""
MISSES = 0.01
TRIES = 100


def add(subparsers: Any) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "suggest",
        help="search for weights, bounds and delays that meet the deadlines",
        description=DESCRIPTION,
        epilog=DETAILS,
    )
    parser.add_argument("policy", metavar="POLICY", help="a file with one ContextPolicy")
    parser.add_argument("timelines", metavar="TIMELINE", nargs="+", help="timelines or recordings")
    parser.add_argument("--profiles", metavar="FILE", required=True, help="what the tasks cost, from robotkit.profiles")
    parser.add_argument(
        "--deadline",
        type=_task_time,
        action="append",
        metavar="TASK=TIME",
        help="time allowed from an input to its result: 100ms",
    )
    parser.add_argument(
        "--priority",
        type=_task_number,
        action="append",
        metavar="TASK=N",
        help="how much misses matter (default: the policy's)",
    )
    parser.add_argument(
        "--misses",
        type=_part,
        default=MISSES,
        metavar="PART",
        help="part of the inputs that may be missed (default: 0.01)",
    )
    parser.add_argument(
        "--tries", type=_count, default=TRIES, metavar="N", help="how many policies to simulate at most (default: 100)"
    )
    parser.add_argument("--delays", action="store_true", help="also change enterAfter, exitAfter and holds")
    robot_arguments.add(parser)
    recording_arguments.add(parser)
    add_output(parser)
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Search, and print the patch with the prediction."""
    from contextpolicy.simulation.knobs import patch

    trial = _trial(arguments)
    with waiting("predicting"):
        before = trial.predict({}) or []
    goals = _goals(arguments, trial)
    if arguments.delays or any(_above(one, goals) for one in before):
        found = _searched(arguments, trial, before, goals)
    else:
        found = _as_it_is(before, goals)
    after = (trial.predict(found.values) if found.values else None) or before
    missed = sorted({task for one in after for task in _above(one, goals)})
    caveats = [f"{task} still misses more than {arguments.misses:g} of its inputs" for task in missed]
    caveats += [note for timeline in trial.timelines for note in timeline.notes]
    caveats += dict.fromkeys(note for one in before for note in one.notes)
    names = [timeline.name for timeline in trial.timelines]
    forecasts = list(zip(names, before, after, strict=True))
    answer = Suggestion(found, forecasts, patch(trial.resource, found.values), caveats)
    print(
        answer.as_text(columns()) if arguments.output == "table" else structured(answer.as_fields(), arguments.output)
    )
    for caveat in caveats:
        print(f"note: {caveat}", file=sys.stderr)
    return 1 if missed else 0


def _searched(
    arguments: argparse.Namespace, trial: Trial, before: Sequence[Forecast], goals: Mapping[str, Goal]
) -> SearchResult:
    from contextpolicy.simulation.knobs import knobs
    from contextpolicy.simulation.search import cost, lowest_floors, search
    from contextpolicy.simulation.trial import demand

    def judge(values: Values) -> float:
        predicted = trial.predict(values) if values else before
        return math.inf if predicted is None else cost(predicted, before, goals)

    def meets(values: Values) -> bool:
        predicted = trial.predict(values)
        return predicted is not None and not any(_above(one, goals) for one in predicted)

    listed = knobs(trial.resource, demand(before, trial.timelines), delays=arguments.delays)
    with progress(arguments.tries, "searching") as advance:
        found = search(listed, _counted(judge, advance), arguments.tries)
    if not meets(found.values):
        return found
    with waiting("lowering min"):
        lowered = lowest_floors(listed, found.values, meets)
    return replace(found, values=lowered, after=judge(lowered))


def _as_it_is(before: Sequence[Forecast], goals: Mapping[str, Goal]) -> SearchResult:
    from contextpolicy.simulation.search import SearchResult, cost

    spent = cost(before, before, goals)
    return SearchResult({}, spent, spent, 1)


@dataclass(frozen=True, slots=True)
class Suggestion:
    """What was found, the name and both predictions of each timeline, the patch, and its caveats."""

    found: SearchResult
    forecasts: list[tuple[str, Forecast, Forecast]]
    patch: list[dict[str, Any]]
    caveats: list[str]

    def as_text(self, width: int | None) -> str:
        """A YAML file: the patch, with the prediction in comments; see `text_table` for `width`."""
        from contextpolicy.simulation.forecast_report import as_table

        room = None if width is None else width - len("# ")
        lines = [
            f"predicted, {self.found.tries} policies tried: cost {self.found.before:.4g} -> {self.found.after:.4g}",
            *(f"caveat: {caveat}" for caveat in self.caveats),
            *([] if self.patch or self.caveats else ["every task meets its goal without a change"]),
        ]
        for name, before, after in self.forecasts:
            lines += ["", f"{name}, without the patch:", *as_table(before, room).splitlines()]
            lines += ["", f"{name}, with the patch:", *as_table(after, room).splitlines()] if self.patch else []
        comments = "\n".join(f"# {part}".rstrip() for line in lines for part in (wrapped(line, room, "", "  ") or [""]))
        return f"{comments}\n" + ("\n".join(f"- {json.dumps(change)}" for change in self.patch) or "[]")

    def as_fields(self) -> dict[str, Any]:
        """The same as fields."""
        from contextpolicy.simulation.forecast_report import as_fields

        parts = {
            name: {"cost": cost, "timelines": {title: as_fields(pair[index]) for title, *pair in self.forecasts}}
            for index, (name, cost) in enumerate((("before", self.found.before), ("after", self.found.after)))
        }
        return {**parts, "tries": self.found.tries, "caveats": self.caveats, "patch": self.patch}


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
    _refuse_unprofiled(arguments.profiles, policy, profiles)
    return Trial(resource, policy, timelines, profiles, robot, plugins.load(policy), deadlines)


def _goals(arguments: argparse.Namespace, trial: Trial) -> dict[str, Goal]:
    """Of every task with a profile: its priority (the policy's, or the one given), and the misses that are allowed."""
    from contextpolicy.simulation.search import Goal

    given = dict(arguments.priority or ())
    own = {task.name: given.get(task.name, task.priority) for task in trial.policy.leaves}
    return {name: Goal(own[name], arguments.misses) for name in trial.profiles.tasks if name in own}


def _above(predicted: Forecast, goals: Mapping[str, Goal]) -> list[str]:
    """The tasks that miss more than their goal allows."""
    from contextpolicy.simulation.forecast import ALL

    missing = {task: stats[ALL].misses for task, stats in predicted.tasks.items() if ALL in stats}
    return [task for task, goal in goals.items() if missing.get(task, 0.0) > goal.misses]


def _counted(judge: Callable[[Values], float], advance: Callable[[float], None] | None) -> Callable[[Values], float]:
    """The same judge, which reports how often it was asked."""
    tries = count(1)

    def counting(values: Values) -> float:
        if advance is not None:
            advance(next(tries))
        return judge(values)

    return counting


def _refuse_unprofiled(file: str, policy: Policy, profiles: Profiles) -> None:
    """Without any profile every task seems to meet its goal."""
    names = [task.name for task in policy.leaves]
    if not profiles.tasks.keys() & set(names):
        allowed = f"profiles of the policy's tasks, at least one of {', '.join(names)}"
        raise SettingsError("arguments", (Finding("--profiles", file, allowed),))


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
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected TASK=TIME, such as slam=100ms") from None


def _task_number(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    return name, _number(value, text, "TASK=N with N of 0 or more", most=1e9)


def _part(text: str) -> float:
    return _number(text, text, "a fraction from 0 to 1", most=1.0)


def _count(text: str) -> int:
    return int(_number(text, text, "an integer from 1 to 100000", most=100_000, least=1))


def _number(text: str, shown: str, allowed: str, *, most: float, least: float = 0) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"invalid value {shown!r}: expected {allowed}")
    return value
