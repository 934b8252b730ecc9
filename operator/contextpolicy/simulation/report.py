"""Plans as text: a table for people, JSON as the decision bus has it, CSV with a row per plan and task."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING, Any

from contextpolicy.explain.text_table import text_table
from contextpolicy.planning.plan_json import plan_json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.policy.spec import Policy

CSV_COLUMNS = ("time", "sequence", "cause", "contexts", "task", "score", "weight", "share", "suspended")


def table(plans: Sequence[Plan], width: int | None = None) -> str:
    """Time, contexts, share and weight of each task, and the cause; a row for each change in these columns.

    See `text_table` for `width`.
    """
    tasks = list(plans[0].tasks) if plans else []
    header = ["TIME", "CONTEXTS", *(f"{name.upper()} (WEIGHT)" for name in tasks), "CAUSE"]
    rows: list[list[str]] = []
    for before, plan in zip([None, *plans], plans, strict=False):
        row = _row(plan, tasks)
        if before is None or before.sequence != plan.sequence or row[1:-1] != rows[-1][1:-1]:
            rows.append(row)
    return "\n".join(text_table(header, rows, width, right={0})) or "  ".join(header)


def _row(plan: Plan, tasks: Sequence[str]) -> list[str]:
    cells = [f"{_share(plan, name)}({plan.tasks[name].weight:.4g})" for name in tasks]
    return [f"{plan.time:.3f}", ", ".join(plan.contexts) or "-", *cells, plan.cause]


def _share(plan: Plan, task: str) -> str:
    """In thousandths of a core; a task without a container of its own has none."""
    return f"{plan.tasks[task].share}m " if any(task in node.shares for node in plan.nodes.values()) else ""


def as_fields(policy: Policy, plans: Sequence[Plan], **about: Any) -> dict[str, Any]:
    """The fields of `about`, then the plans as on the decision bus (`plan_json`)."""
    return {"policy": policy.reference, **about, "plans": [plan_json(policy, plan) for plan in plans]}


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
