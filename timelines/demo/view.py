"""The demo on a terminal: live while it runs, a summary when it ends."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.bus.view_tables import cores, titled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from timelines.demo.recorder import Recording
    from timelines.demo.verdict import Reaction


def live(recording: Recording, elapsed: float, duration: float) -> Table:
    """Which context holds, and what each task gets and uses now."""
    plan = recording.plans[-1] if recording.plans else None
    contexts = ", ".join(plan["contexts"]) if plan else ""
    title = f"{elapsed:4.1f} s of {duration:g} s   context: {contexts or '-'}"
    table = titled(
        title, ("task", "weight", "share", "weight in cgroup", "quota in cgroup", "CPU use", ""), left=("task", "")
    )
    for name, task in (plan["tasks"] if plan else {}).items():
        used = recording.cores_used(name)
        table.add_row(
            *(name, f"{task['weight']:g}", cores(task["share"]), str(recording.weight(name) or "-")),
            *(cores(recording.limit(name)), cores(used)),
            "#" * round(used * 20) + ("  suspended" if task["suspended"] else ""),
        )
    return table


def summary(found: Sequence[Reaction]) -> Table:
    """Every reaction: when, why, what changed, how fast."""
    table = titled(
        "Reactions (milliseconds since the sample, or since the timer that was due)",
        ("at", "cause", "what changed", "plan", "patch", "cgroup"),
        left=("cause", "what changed"),
    )
    for reaction in found:
        table.add_row(
            f"{reaction.at:.1f} s",
            reaction.cause.split("; ")[-1],
            " ".join(f"{task}={cores(share)}" for task, share in reaction.moved.items()),
            *(_ms(value) for value in (reaction.plan_ms, reaction.patch_ms, reaction.cgroup_ms)),
        )
    return table


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
