"""What a `BusView` looks like in a terminal: for each policy a headline, and tables of its tasks and streams."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from contextpolicy.explain.text_table import printable, text_table
from contextpolicy.policy.spec import Mode

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from contextpolicy.bus.view import BusView, PolicyView

TASK = ("task", "weight", "share", "limit", "use", "throttled", "stage")
STREAM = ("stream", "age", "samples", "state")
LEFT = ("task", "stage", "stream", "state")
"""The columns that hold text; the others are numbers, aligned at the right."""
RULE = " | "
WORDS = {"planned": "planned", "accepted": "accepted", "inForce": "in force"}


def live(view: BusView, now: float, width: int = 200) -> Group | Text:
    """A table for each policy; a terminal of a `width` that they don't fit has a paragraph for each row."""
    if not view.policies:
        return Text("no plans yet")
    policies = [policy for _, policy in sorted(view.policies.items())]
    boards = view.boards
    return Group(*(part for policy in policies for part in _parts(policy, boards.get(policy.policy), now, width)))


def _parts(policy: PolicyView, board: Mapping[str, Any] | None, now: float, width: int) -> Iterator[Text | Table]:
    yield _headline(policy, now)
    if board is None:
        yield Text("its operator does not respond: showing its last report", style="reverse")
    yield _fitted(TASK, _tasks(policy, board["containers"] if board else ()), width)
    if board is not None:
        if board["streams"]:
            yield _fitted(STREAM, _streams(board["streams"]), width)
        yield _reactions(board["reactions"])


def _headline(policy: PolicyView, now: float) -> Text:
    """A line above the table: a title would wrap at its width. `Text`, because a cause may contain [brackets]."""
    mode = "" if policy.mode == Mode.ENFORCE else f"   {policy.mode}"
    contexts = ", ".join(policy.contexts) or "-"
    age = max(0.0, now - policy.time)
    line = f"{policy.policy}{mode}   context: {contexts}   for {age:.0f} s: {policy.cause}"
    return Text(printable(line), style="bold")


def _fitted(headings: Sequence[str], rows: Iterable[Sequence[str]], width: int) -> Text | Table:
    """A table with rules between its columns where there is room for it."""
    shown = list(rows)
    needed = sum(max(len(row[i]) for row in (headings, *shown)) + len(RULE) for i in range(len(headings))) + 1
    if needed > width:
        right = {i for i, heading in enumerate(headings) if heading not in LEFT}
        return Text("\n".join(text_table(headings, shown, width, right=right)))
    table = titled("", headings, left=LEFT)
    for row in shown:
        table.add_row(*map(Text, map(printable, row)))
    return table


def _tasks(policy: PolicyView, containers: Sequence[Mapping[str, Any]]) -> Iterator[Sequence[str]]:
    for name, task in policy.tasks.items():
        own = [container for container in containers if container["task"] == name]
        stage = WORDS.get(policy.stage(name) or "", "-")
        suspended = "   suspended" if task["suspended"] else ""
        parts = [part for one in own if (part := one["throttled"]) is not None]
        yield (
            name,
            f"{task['weight']:g}",
            cores(task["share"]),
            cores(_sum(one["limit"] for one in own)),
            cores(_sum(one["use"] for one in own)),
            f"{max(parts):.0%}" if parts else "-",
            stage + suspended,
        )


def _sum(amounts: Iterable[float | None]) -> float | None:
    known = [amount for amount in amounts if amount is not None]
    return sum(known) if known else None


def _streams(streams: Mapping[str, Mapping[str, Any]]) -> Iterator[Sequence[str]]:
    for name, stream in streams.items():
        age = "-" if stream["age"] is None else f"{stream['age']:.1f} s"
        state = "silent" if stream["silent"] else "not heard yet" if stream["age"] is None else "heard"
        yield name, age, str(stream["samples"]), state


def _reactions(reactions: Mapping[str, float] | None) -> Text:
    if reactions is None:
        return Text("no reaction to a sample yet")
    figures = (f"{name} {reactions[name] * 1000:.0f} ms" for name in ("median", "worst", "last"))
    return Text(f"sample to change in force: {', '.join(figures)} of the latest {reactions['count']:.0f}")


def titled(title: str, headings: Sequence[str], *, left: Sequence[str]) -> Table:
    """An empty table; the columns named in `left` hold text, the others right-aligned numbers."""
    table = Table(title=Text(title) if title else None, title_justify="left")
    for heading in headings:
        table.add_column(heading, justify="left" if heading in left else "right")
    return table


def cores(value: float | None) -> str:
    """Cores as Kubernetes' thousandths, such as 150m; a dash for None."""
    return "-" if value is None else f"{value * 1000:.0f}m"
