"""`python -m timelines.demo`: run the demo; exit code 0 only if the kernel enforced the policy."""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from dataclasses import asdict
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live

from contextpolicy.bus.view_tables import cores
from contextpolicy.streams.timeline import load
from timelines.demo import bus, cgroup, deploy, picture, verdict, view
from timelines.demo.recorder import Recorder
from timelines.demo.verdict import Conversion
from timelines.replay.player import play

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from timelines.demo.cgroup import Cgroup
    from timelines.demo.recorder import Recording

TIMELINE = deploy.REPOSITORY / "timelines" / "exp2.json"
OUT = deploy.REPOSITORY / "build" / "demo"
CONTEXTS = {"moving"}
console = Console() if sys.stdout.isatty() else Console(width=120)  # a pipe has no width, and 80 would cut lines


def main() -> int:
    """Twice, without and with the node agent: deploy, play, judge; then clean up."""
    parser = argparse.ArgumentParser(prog="python -m timelines.demo", description=__doc__)
    parser.add_argument("--keep", action="store_true", help="leave the operator, the modules and the policy running")
    options = parser.parse_args()
    try:
        problems = _run(agent=False, keep=False) + _run(agent=True, keep=options.keep)
        for step in () if options.keep else deploy.down():
            console.print(f"[bold]$ {step}[/]")
    except deploy.DeployError as error:
        console.print(f"[red]{error}[/]")
        return 1
    for problem in problems:
        console.print(f"[red]{problem}[/]")
    console.print("[red]The demo failed.[/]" if problems else "[green]Kernel and API had what every plan says.[/]")
    return 1 if problems else 0


def _run(*, agent: bool, keep: bool) -> list[str]:
    """One minute of the robot; what went wrong."""
    console.print("[bold]With the node agent[/]" if agent else "[bold]Through the API alone[/]")
    for step in deploy.up(agent=agent):
        console.print(f"[bold]$ {step}[/]")
    original = deploy.limits()
    console.print(f"[bold]$ kubectl apply -f {deploy.POLICY.relative_to(deploy.REPOSITORY)}[/]")
    deploy.apply_policy()
    recording, started, conversion = _play(agent=agent)
    problems = _report(recording, started, conversion, OUT / ("agent" if agent else "api"))
    return problems if keep else problems + _withdraw(original)


def _play(*, agent: bool) -> tuple[Recording, float, Conversion]:
    """Play the timeline and show what happens; returns the recording and when it started (Unix time)."""
    timeline = load(TIMELINE)
    cgroups = {task: found for task, identity in deploy.containers().items() if (found := cgroup.find(identity))}
    if len(cgroups) < len(deploy.limits()):
        raise deploy.DeployError("the cgroups of the tasks are not on this machine: run the demo on the node")
    stop = threading.Event()
    with (
        bus.session("sensor", closed=agent) as sensors,
        bus.session("module", closed=agent) as viewer,  # viewers hear no samples
        Recorder(viewer, f"{deploy.ROBOT}/{deploy.POLICY.stem}", cgroups) as recorder,
    ):
        started = time.time()
        player = threading.Thread(target=play, args=(timeline, sensors), kwargs={"stop": stop}, daemon=True)
        player.start()
        _show(recorder.recording, player, started, timeline.duration)
        player.join(timeout=timeline.duration)
        return recorder.recording, started, _conversion(cgroups, agent=agent)


def _conversion(cgroups: Mapping[str, Cgroup], *, agent: bool) -> Conversion:
    """How the policy's weights arrive on this node."""
    version = next(iter(cgroups.values())).version
    protected = None if agent else deploy.PROTECTED
    return Conversion(version, deploy.request_factor(), deploy.requests_beside(), protected)


def _show(recording: Recording, player: threading.Thread, started: float, duration: float) -> None:
    if not console.is_terminal:
        _show_lines(recording, player, started)
        return
    with Live(console=console, refresh_per_second=4) as display:
        while player.is_alive():
            player.join(timeout=0.25)
            display.update(view.live(recording, time.time() - started, duration))


def _show_lines(recording: Recording, player: threading.Thread, started: float) -> None:
    """Without a terminal: one line per plan; its later editions move no share."""
    shown = 0
    while player.is_alive():
        player.join(timeout=0.25)
        fresh = recording.plans[shown:]  # others may come while these are printed
        shown += len(fresh)
        for plan in fresh:
            if plan.get("edition", 0):
                continue
            shares = " ".join(f"{name}={task['share'] * 1000:.0f}m" for name, task in plan["tasks"].items())
            line = (
                f"{plan['trigger'] - started:6.2f} s  {','.join(plan['contexts']) or '-':10} {shares}  {plan['cause']}"
            )
            console.print(line, highlight=False, soft_wrap=True)


def _report(recording: Recording, started: float, conversion: Conversion, out: Path) -> list[str]:
    out.mkdir(parents=True, exist_ok=True)
    found = verdict.reactions(recording, started, conversion)
    console.print(view.summary(found))
    for stage, value in verdict.medians(found).items():
        console.print(f"median {stage}: {value:.1f} ms")
    for moment, task, before, after in verdict.patches(recording, started):
        console.print(f"{moment:6.2f} s  CPU limit of {task} patched in place: {cores(before)} to {cores(after)}")
    picture.draw(recording, deploy.TASKS, started, load(TIMELINE).duration, out / "shares.svg")
    (out / "recording.json").write_text(json.dumps(asdict(recording), indent=1))
    console.print(f"picture: {(out / 'shares.svg').relative_to(deploy.REPOSITORY)}")
    return verdict.mismatches(recording, CONTEXTS, conversion)


def _withdraw(original: dict[str, str]) -> list[str]:
    console.print(f"[bold]$ kubectl delete -f {deploy.POLICY.relative_to(deploy.REPOSITORY)}[/]")
    deploy.delete_policy()
    restored = deploy.limits()
    if restored != original:
        return [f"after the policy was deleted the limits were {restored}, before it {original}"]
    console.print(f"after the policy was deleted the limits were as before: {restored}")
    return []


if __name__ == "__main__":
    sys.exit(main())
