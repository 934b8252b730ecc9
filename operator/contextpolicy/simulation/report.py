"""Plans as text: a table for people, JSON as the decision bus has it, CSV with a row per plan and task."""

from __future__ import annotations

import csv
import io
import json
from typing import TYPE_CHECKING, Any

from contextpolicy.planning.plan_json import plan_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.policy.spec import Policy

CSV_COLUMNS = ("time", "sequence", "cause", "contexts", "task", "score", "weight", "share", "suspended")


def table(plans: Sequence[Plan]) -> str:
    """Time, contexts, share and weight of each task, and the cause; a row for each change in these columns."""
    tasks = list(plans[0].tasks) if plans else []
    header = ["TIME", "CONTEXTS", *(f"{name.upper()} (WEIGHT)" for name in tasks), "CAUSE"]
    rows = [header]
    for before, plan in zip([None, *plans], plans, strict=False):
        row = _row(plan, tasks)
        if before is None or before.sequence != plan.sequence or row[1:-1] != rows[-1][1:-1]:
            rows.append(row)
    widths = [max(len(row[column]) for row in rows) for column in range(len(header) - 1)]
    return "\n".join(
        "  ".join([row[0].rjust(widths[0]), *(c.ljust(w) for c, w in zip(row[1:-1], widths[1:], strict=True)), row[-1]])
        for row in rows
    )


def _row(plan: Plan, tasks: Sequence[str]) -> list[str]:
    cells = [f"{_share(plan, name)}({plan.tasks[name].weight:.4g})" for name in tasks]
    return [f"{plan.time:.3f}", ", ".join(plan.contexts) or "-", *cells, plan.cause]


def _share(plan: Plan, task: str) -> str:
    """In thousandths of a core; a task without a container of its own has none."""
    return f"{plan.tasks[task].share}m " if any(task in node.shares for node in plan.nodes.values()) else ""


def as_json(policy: Policy, plans: Sequence[Plan], **about: Any) -> str:
    """One document: the fields of `about`, then the plans as on the decision bus (`plan_json`)."""
    return json.dumps(
        {"policy": policy.reference, **about, "plans": [plan_json(policy, plan) for plan in plans]}, indent=2
    )


def as_csv(plans: Sequence[Plan]) -> str:
    """A row per plan and task; several contexts are joined by `;`."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for plan in plans:
        for name, task in plan.tasks.items():
            own = (name, task.score, task.weight, task.share / 1000, task.suspended)
            writer.writerow((plan.time, plan.sequence, plan.cause, ";".join(plan.contexts), *own))
    return text.getvalue().rstrip("\n")
