"""`contextpolicy simulate`: a policy against a timeline, without robot and cluster."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contextpolicy.commands.validate import add_types_argument

if TYPE_CHECKING:
    from contextpolicy.policy.spec import Policy
    from contextpolicy.simulation.run import Simulation
    from contextpolicy.streams.timeline import Timeline

DESCRIPTION = """\
Run a policy against a timeline in virtual time, with the very planning code that runs on the robot, and print each plan
with its cause. Each task runs once, on one node. Inputs whose key a stream selects become its samples, whatever the
stream's encoding; recordings (inputs without a value) are skipped."""

EXPECTATIONS = """\
expectations (--assert FILE): a YAML or JSON list; exit code 1 and a line for each difference if one does not hold

  - at: 12.0                       # at one instant, or throughout an interval: from: 13, to: 20
    contexts: [moving]             # exactly these contexts hold
    suspended: [speech]            # exactly these tasks are suspended
    shares:                        # an exact share, or its bounds
      speech: 10m
      slam: {min: 1500m, max: "2"}
    weights: {slam: 10}
    feasible: true                 # every need and floor is met
  - {from: 0, to: 30, plans: {max: 8}}     # at most 8 plans begin: a bound on flapping

exit codes: 0 as expected, 1 a difference or an invalid file, 2 wrong usage"""


def add(subparsers: Any) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "simulate",
        help="run a policy against a timeline in virtual time",
        description=DESCRIPTION,
        epilog=EXPECTATIONS,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("policy", metavar="POLICY", help="a file with one ContextPolicy")
    parser.add_argument("timeline", metavar="TIMELINE", help="a timeline file")
    add_run_arguments(parser)
    parser.add_argument("--until", type=seconds, metavar="S", help="stop after S seconds (default: the whole timeline)")
    parser.add_argument("--output", choices=("table", "json", "csv"), default="table", help="default: table")
    parser.add_argument(
        "--plot", metavar="FILE", type=_picture, help="draw weights, contexts and shares (.svg or .png)"
    )
    parser.add_argument("--assert", dest="expected", metavar="FILE", help="compare with expected plans, see below")
    parser.set_defaults(main=main)


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """What a simulated robot is, for every command that simulates."""
    parser.add_argument(
        "--cores", type=_cores, default=4.0, metavar="N", help="CPUs of the robot (default: 4, a Raspberry Pi)"
    )
    add_types_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    """Simulate, print, draw and compare."""
    policy, inputs = read_files(arguments)
    expected = _expected(arguments.expected, policy) if arguments.expected else None
    run = run_policy(policy, inputs, cores=arguments.cores, until=arguments.until)
    if expected is None or arguments.output != "table":
        _print(arguments, policy, inputs, run)
    if arguments.plot:
        _draw(arguments.plot, policy, inputs, run)
    _print_notes(run)
    return 0 if expected is None else _compare(arguments, run, expected)


def read_files(arguments: argparse.Namespace) -> tuple[Policy, Timeline]:
    """The policy and the timeline that the command line names."""
    from contextpolicy.policy.definition_files import of_folder
    from contextpolicy.policy.validation.policy_file import load_policy
    from contextpolicy.streams import timeline

    types = of_folder(arguments.types) if arguments.types else None
    return load_policy(arguments.policy, types), timeline.load(arguments.timeline, types or ())


def run_policy(policy: Policy, inputs: Timeline, *, cores: float, until: float | None) -> Simulation:
    """Simulate with the installed initiatives."""
    from contextpolicy import plugins
    from contextpolicy.simulation.run import simulate

    return simulate(policy, inputs, cores=cores, until=until, initiatives=plugins.load(policy))


def seconds(text: str) -> float:
    """A point in time on the command line."""
    value = float(text)
    if not 0 < value < 10**7:
        raise argparse.ArgumentTypeError(f"{text} is not allowed: seconds above 0")
    return value


def _cores(text: str) -> float:
    value = float(text)
    if not 0 < value <= 1024:
        raise argparse.ArgumentTypeError(f"{text} is not allowed: above 0 to 1024")
    return value


def _picture(text: str) -> Path:
    path = Path(text)
    if path.suffix not in (".svg", ".png"):
        raise argparse.ArgumentTypeError(f"{text} is not allowed: a file name that ends in .svg or .png")
    return path


def _print(arguments: argparse.Namespace, policy: Policy, inputs: Timeline, run: Simulation) -> None:
    from contextpolicy.simulation import report

    match arguments.output:
        case "json":
            about = {"timeline": inputs.name, "cores": arguments.cores, "until": run.until}
            print(report.as_json(policy, run.plans, **about))
        case "csv":
            print(report.as_csv(run.plans))
        case _:
            print(report.table(run.plans))


def _draw(path: Path, policy: Policy, inputs: Timeline, run: Simulation) -> None:
    from contextpolicy.simulation import series
    from contextpolicy.simulation.drawing import draw_shares

    draw_shares(
        series.shares(run.plans),
        series.contexts(run.plans, run.until),
        path,
        until=run.until,
        weights=series.normalised_weights(run.plans),
        title=f"{policy.name} on {inputs.name} ({policy.scheduler})",
    )


def _print_notes(run: Simulation) -> None:
    """What a reader of the plans would not see: inputs that nobody read, samples that were not used, CEL errors."""
    notes = [
        *(f"no stream reads {key}" for key in sorted(run.skipped.unread)),
        *(f"{key} is a recording, without values" for key in sorted(run.skipped.without_value)),
        *(f"{stream or 'policy'}: {reason}, {count} times" for (stream, reason), count in run.planner.drops.items()),
        *(f"{source}: {error}" for source, error in run.planner.errors.items()),
    ]
    if not run.plans:
        waiting = [name for name, stream in run.planner.streams.items() if stream.unknown]
        notes.append(f"there is no plan: it waits until each stream is heard or silent: {', '.join(waiting)}")
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


def _expected(path: str, policy: Policy) -> Any:
    from contextpolicy.errors import Finding
    from contextpolicy.simulation.expectations import ExpectationError, parse

    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ExpectationError(path, (Finding("file", path, f"a readable file ({error})"),)) from error
    return parse(text, policy, subject=path)


def _compare(arguments: argparse.Namespace, run: Simulation, expected: Any) -> int:
    from contextpolicy.simulation.comparison import differences

    beyond = [e for e in expected if e.end > run.until]
    found = [*(f"line {e.line}: expects something at {e.end:g} s, after the end at {run.until:g} s" for e in beyond)]
    found += [str(difference) for difference in differences(run.plans, [e for e in expected if e not in beyond])]
    for difference in found:
        print(f"{arguments.expected}: {difference}", file=sys.stderr)
    verdict = f"{len(found)} differences" if found else "as expected"
    print(f"{arguments.policy} on {arguments.timeline}: {len(expected)} expectations, {verdict}", file=sys.stderr)
    return 1 if found else 0
