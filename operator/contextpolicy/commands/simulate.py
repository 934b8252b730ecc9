"""`contextpolicy simulate`: a policy against a timeline, without a robot or a cluster."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contextpolicy.commands import recording_arguments, robot_arguments
from contextpolicy.commands.robot_arguments import robot_of, seconds
from contextpolicy.commands.structured_output import add_output, structured
from contextpolicy.commands.terminal import columns, progress, waiting

if TYPE_CHECKING:
    from contextpolicy.policy.spec import Policy
    from contextpolicy.simulation.forecast import Forecast
    from contextpolicy.simulation.robot import Robot
    from contextpolicy.simulation.run import Simulation
    from contextpolicy.streams.timeline import Timeline

DESCRIPTION = """\
Run a policy against a timeline in virtual time, with the same planning code as on the robot, and print each plan with
its cause. Inputs whose key a stream selects become its samples, whatever the stream's encoding; data sets (inputs
without a value) are skipped. TIMELINE can also be a recording: streams find its ROS 2 topics by rmw_zenoh's keys
(in domain 0) and by those of zenoh-bridge-ros2dds. Notes on standard error, and in JSON, report what plans do not show:
inputs that no stream reads, streams without input, samples and expressions that fail, and needs that are not met.

Virtual time starts when the recording started; with a timeline, at 2000-01-01 00:00 UTC, so that a forced context
has not expired. If a stream has timestamps of a real clock (2000 to 2100), virtual time starts so that the first one
is current."""

DETAILS = """\
output (--output): a table; or the fields

  json   schemaVersion, policy, timeline, cores (of all nodes), until (s), notes (sentences), plans: a list, as on the
         decision bus (or the same as yaml):
         policy, mode, scheduler, control; sequence, time (s from the timeline's start), cause, contexts (that hold);
         shortfalls (task, message: what is not feasible); tasks by name: score, weight, share (cores), suspended,
         because; nodes by name: capacity (cores), scheduler, dividedBy (Weight; Priority while all are at rest;
         Nothing while all are suspended), tasks and their shares
  csv    a row for each plan and task: time, sequence, cause, contexts (joined by ;), task, score, weight, share,
         suspended, as in json

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
  - {from: 0, to: 30, misses: {slam: {max: 0.01}}}   # with --profiles: at most 1 % of its inputs are late or dropped

prediction (--profiles FILE, as robotkit.profiles writes it; experimental): work arrives with the timeline's inputs (a
data set's by the rate in the timeline), waits in queues that drop their oldest, and is served as CFS does, 30 ms after
each plan. By task and context it prints the inputs; those done, late, dropped, and suspended; misses (late, dropped,
or overdue at the end, as a fraction of those due); the worst misses of the four phases of the kernel's period that it
tries, all equally likely; response time p50 and p99; how many inputs were waiting when one arrived; and the cores that
stay idle. What one task publishes for another is not predicted, and a task that adapts its quality to its share is
predicted at full cost."""


def add(subparsers: Any) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "simulate",
        help="run a policy against a timeline in virtual time",
        description=DESCRIPTION,
        epilog=DETAILS,
    )
    parser.add_argument("policy", metavar="POLICY", type=_file, help="a file with one ContextPolicy, - for stdin")
    parser.add_argument(
        "timeline",
        metavar="TIMELINE",
        type=_file,
        help="a timeline, an MCAP file, or a rosbag2 folder or .db3; - for a timeline on stdin",
    )
    robot_arguments.add(parser)
    recording_arguments.add(parser)
    parser.add_argument("--until", type=seconds, metavar="S", help="stop after S seconds (default: the whole timeline)")
    add_output(parser, "csv")
    parser.add_argument(
        "--plot", metavar="FILE", type=_picture, help="draw weights, contexts and shares (.svg or .png)"
    )
    parser.add_argument(
        "--assert", dest="expected", metavar="FILE", type=_file, help="compare with expected plans, - for stdin"
    )
    parser.add_argument("--profiles", metavar="FILE", help="predict queues, response times and misses (experimental)")
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    """Simulate, print, draw and compare."""
    from contextpolicy.simulation.notes import notes

    _refuse_two_readers(arguments)
    policy, inputs = read_files(arguments)
    expected = _expected(arguments.expected, policy) if arguments.expected else None
    robot = robot_of(arguments, policy)
    _refuse_unpredicted(arguments, expected)
    run = run_policy(policy, inputs, robot=robot, until=arguments.until)
    predicted = predict(arguments.profiles, policy, inputs, run) if arguments.profiles else None
    listed = [*inputs.notes, *notes(policy, robot, run), *(predicted.notes if predicted else ())]
    if expected is None or arguments.output != "table":
        about: dict[str, Any] = {"cores": sum(robot.nodes.values()) / 1000, "notes": listed}
        _print(arguments.output, policy, inputs, run, predicted, about=about)
    if arguments.plot:
        _draw(arguments.plot, policy, inputs, run)
    for note in listed:
        print(f"note: {note}", file=sys.stderr)
    return 0 if expected is None else _compare(arguments, run, predicted, expected)


def predict(path: str, policy: Policy, inputs: Timeline, run: Simulation) -> Forecast:
    """What the plans of a run do to each task's inputs."""
    from contextpolicy.simulation.forecast import forecast
    from contextpolicy.simulation.profiles import load_profiles

    profiles = load_profiles(path)
    with waiting("predicting"):
        return forecast(policy, inputs, run.plans, profiles, until=run.until)


def read_files(arguments: argparse.Namespace) -> tuple[Policy, Timeline]:
    """The policy and the timeline that the command line names."""
    from contextpolicy.policy.definition_files import of_folder
    from contextpolicy.policy.validation.policy_file import load_policy

    types = of_folder(arguments.types) if arguments.types else None
    policy = load_policy(arguments.policy, types)
    return policy, recording_arguments.load_inputs(arguments, policy, types or ())


def run_policy(policy: Policy, inputs: Timeline, *, robot: Robot, until: float | None) -> Simulation:
    """Simulate with the installed initiatives, with a progress bar on a terminal."""
    from contextpolicy.policies import plugins
    from contextpolicy.simulation.run import simulate

    with progress(inputs.duration if until is None else until, "simulating") as advance:
        return simulate(policy, inputs, robot=robot, until=until, initiatives=plugins.load(policy), on_progress=advance)


def _file(text: str) -> str:
    return STANDARD_INPUT if text == "-" else text


STANDARD_INPUT = "/dev/stdin"


def _refuse_two_readers(arguments: argparse.Namespace) -> None:
    from contextpolicy.errors import Finding, SettingsError

    names = [name for name in ("policy", "timeline", "expected") if getattr(arguments, name) == STANDARD_INPUT]
    if len(names) > 1:
        raise SettingsError(
            "arguments", tuple(Finding(name, "-", "a file, as only one input can be stdin") for name in names[1:])
        )


def _refuse_unpredicted(arguments: argparse.Namespace, expected: Any) -> None:
    """Refuse expected misses without profiles: they would pass unchecked."""
    from contextpolicy.errors import Finding, SettingsError

    lines = [str(one.line) for one in expected or () if one.misses is not None]
    if lines and not arguments.profiles:
        allowed = f"a file of profiles: line {', '.join(lines)} of {arguments.expected} expects misses"
        raise SettingsError("arguments", (Finding("--profiles", None, allowed),))


def _picture(text: str) -> Path:
    path = Path(text)
    if path.suffix not in (".svg", ".png"):
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected a file name that ends in .svg or .png")
    if not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"invalid value {text!r}: expected a file in a folder that exists")
    return path


def _print(  # noqa: PLR0913 - all that a run gives
    output: str,
    policy: Policy,
    inputs: Timeline,
    run: Simulation,
    predicted: Forecast | None,
    *,
    about: dict[str, Any],
) -> None:
    from contextpolicy.simulation import forecast_report, report

    match output:
        case "json" | "yaml":
            if predicted is not None:
                about["forecast"] = forecast_report.as_fields(predicted)
            content = report.as_fields(policy, run.plans, timeline=inputs.name, until=run.until, **about)
            print(structured(content, output))
        case "csv":
            print(report.as_csv(run.plans))
        case _:
            print(report.table(run.plans, columns()))
            if predicted is not None:
                print(f"\n{forecast_report.as_table(predicted, columns())}")


def _draw(path: Path, policy: Policy, inputs: Timeline, run: Simulation) -> None:
    from contextpolicy.simulation import series
    from contextpolicy.simulation.drawing import draw_shares

    draw_shares(
        series.shares(run.plans),
        series.contexts(run.plans, run.until),
        path,
        until=run.until,
        weights=series.normalised_weights(run.plans),
        title=f"{policy.name} on {inputs.name} ({policy.enforcement.scheduler})",
    )


def _expected(path: str, policy: Policy) -> Any:
    from contextpolicy.errors import Fault, Finding, unreadable
    from contextpolicy.simulation.expectations import ExpectationError, parse

    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ExpectationError(path, (Finding("", None, unreadable(error), Fault.FILE),)) from error
    return parse(text, policy, subject=path)


def _compare(arguments: argparse.Namespace, run: Simulation, predicted: Forecast | None, expected: Any) -> int:
    from contextpolicy.simulation.comparison import differences

    # After the end the last plan would be taken for in force, and such an expectation might pass unchecked.
    beyond = [e for e in expected if e.end > run.until]
    within = [e for e in expected if e not in beyond]
    found = [*(f"line {e.line}: expectation at {e.end:g} s, but the run ends at {run.until:g} s" for e in beyond)]
    found += [str(difference) for difference in differences(run.plans, within, predicted)]
    for difference in found:
        print(f"{arguments.expected}: {difference}", file=sys.stderr)
    verdict = f"{len(found)} differences" if found else "as expected"
    print(f"{arguments.policy} on {arguments.timeline}: {len(expected)} expectations, {verdict}", file=sys.stderr)
    return 1 if found else 0
