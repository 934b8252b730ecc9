"""The result as text. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

GOALS = {
    "operator_overhead_ms_p50": ("at most 3", "sample to first patch accepted, less a bare PATCH"),
    "agent_over_docker_update_p50": ("at most 0.2", "sample to cgroup through the agent / docker update"),
    "agent_over_cgroup_write_p50": ("", "sample to cgroup through the agent / a direct write"),
}


def text(result: Mapping[str, Any]) -> str:
    """All parts that were measured."""
    parts = [
        str(result["machine"]),
        *(part(name, result.get(name, [])) for name in ("storm", "transition", "priority", "control", "autoscaler")),
    ]
    if result["table"]:
        parts[1:1] = [part("table", result["table"]), part("peers", result["peers"]), _keys(result)]
    parts += [f"not measured: {path}: {reason}" for path, reason in result["unmeasured"].items()]
    parts += [f"missed: {reason}" for reason in result["missed"]]
    parts += [f"left to measure, with --resume: {step}" for step in result["left"]]
    parts += [f"{result['disturbed']} measurements began beside other work on this machine"]
    return "\n\n".join(part for part in parts if part)


def _keys(result: Mapping[str, Any]) -> str:
    return "\n".join(
        f"{name:29} {result[name]!s:>8}  {what}; goal: {goal or '-'}" for name, (goal, what) in GOALS.items()
    )


def part(name: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """The columns are the rows' own names."""
    if not rows:
        return ""
    columns = list(rows[0])
    lines = [columns, *([str(row[column]) for column in columns] for row in rows)]
    widths = [max(len(line[number]) for line in lines) for number in range(len(columns))]
    return "\n".join([f"{name}:", *("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)])
