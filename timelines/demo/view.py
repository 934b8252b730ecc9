"""The demo on a terminal: live while it runs, a summary when it ends."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from timelines.demo.recorder import Recording
    from timelines.demo.verdict import Reaction


def live(recording: Recording, elapsed: float, duration: float) -> Table:
    """Which context holds, and what each task gets and uses now."""
    plan = recording.plans[-1] if recording.plans else None
    contexts = ", ".join(plan["contexts"]) if plan else ""
    table = Table(title=f"{elapsed:4.1f} s of {duration:g} s   context: {contexts or '-'}", title_justify="left")
    for heading in ("task", "weight", "limit", "quota in cgroup", "CPU use", ""):
        table.add_column(heading, justify="left" if heading in ("task", "") else "right")
    for name, task in (plan["tasks"] if plan else {}).items():
        used = recording.cores_used(name)
        table.add_row(
            *(name, f"{task['weight']:g}", _cores(task["share"]), _cores(recording.limit(name)), _cores(used)),
            "#" * round(used * 20) + ("  suspended" if task["suspended"] else ""),
        )
    return table


def summary(found: Sequence[Reaction]) -> Table:
    """Every reaction: when, why, what each task got, how fast."""
    tasks = sorted({task for reaction in found for task in reaction.shares})
    table = Table(
        title="Reactions (milliseconds since the sample, or since the timer that was due)", title_justify="left"
    )
    for heading in ("at", "cause", "contexts", *tasks, "plan", "patch", "cgroup"):
        table.add_column(heading, justify="left" if heading in ("cause", "contexts") else "right")
    for reaction in found:
        table.add_row(
            f"{reaction.at:.1f} s",
            reaction.cause.split("; ")[-1],
            ", ".join(reaction.contexts) or "-",
            *(_cores(reaction.shares[task]) for task in tasks),
            *(_ms(value) for value in (reaction.plan_ms, reaction.patch_ms, reaction.cgroup_ms)),
        )
    return table


def _cores(value: float | None) -> str:
    return "-" if value is None else f"{value * 1000:.0f}m"


def _ms(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
