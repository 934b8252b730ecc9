"""What is in the picture: streams, tasks, needs and contexts, and how they are connected."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

from contextpolicy.explain.explanation import change
from contextpolicy.planning.allocation.weights import Obstacles, Weigher
from contextpolicy.policy.activities import Enforce
from contextpolicy.policy.cel import shared
from contextpolicy.policy.quantities import format_cpu
from contextpolicy.policy.spec import SatisfiedBy

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Context, Policy, Task


class Kind(StrEnum):
    """What a node stands for."""

    STREAM = "stream"
    TASK = "task"
    GROUP = "group"
    NEED = "need"
    CONTEXT = "context"


class Relation(StrEnum):
    """What an edge stands for."""

    ACTIVITY = "activity"
    CONDITION = "condition"
    PRODUCES = "produces"
    SUBTASK = "subtask"
    NEEDS = "needs"
    READS = "reads"
    CHANGES = "changes"


@dataclass(frozen=True, slots=True)
class GraphNode:
    """A box: its first line is its name, the others add detail. `suspended`: the chosen context rules it out.

    Neither its lines nor edge labels have control characters: SVG can't hold them, and Mermaid reads line by line.
    """

    id: str
    kind: Kind
    lines: tuple[str, ...]
    suspended: bool = False


@dataclass(frozen=True, slots=True)
class Edge:
    """An arrow."""

    source: str
    target: str
    relation: Relation
    label: str = ""


@dataclass(slots=True)
class Graph:
    """A picture before it is drawn."""

    title: str
    nodes: list[GraphNode] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)


def build(policy: Policy, *, context: str | None = None) -> Graph:
    """The graph with all contexts, or as one context modifies it: that one alone, and what it suspends."""
    chosen = [own for own in policy.contexts if context in (None, own.name)]
    suspended = _suspended(policy, chosen[0]) if context is not None else set()
    title = policy.name if context is None else f"{policy.name} while {context} holds"
    graph = Graph(title)
    for stream in policy.streams:
        graph.nodes.append(GraphNode(f"stream-{stream.name}", Kind.STREAM, (stream.name, _line(stream.key))))
        if stream.produced_by:
            graph.edges.append(Edge(f"task-{stream.produced_by}", f"stream-{stream.name}", Relation.PRODUCES))
    for task in policy.tasks:
        _add_task(graph, task, suspended=task.name in suspended)
    for own in chosen:
        _add_context(graph, own)
    shown = {node.id for node in graph.nodes}
    graph.edges = [edge for edge in graph.edges if edge.source in shown]  # of a context that was not chosen
    return graph


def _suspended(policy: Policy, context: Context) -> set[str]:
    """The tasks that cannot run in this context, when all else is well: what it suspends, and what depends on that."""
    scores = {task.name: 1.0 for task in policy.tasks}
    weights = Weigher(policy).weigh(scores, Obstacles({}), [context])
    return {name for name, weight in weights.items() if not weight.able}


def _add_task(graph: Graph, task: Task, *, suspended: bool) -> None:
    node = f"task-{task.name}"
    graph.nodes.append(GraphNode(node, Kind.GROUP if task.subtasks else Kind.TASK, _task_lines(task), suspended))
    graph.edges += [Edge(node, f"task-{name}", Relation.SUBTASK) for name in task.subtasks]
    graph.edges += _merged(list(_input_edges(task)))
    needs = _needs(task)
    if needs:
        graph.nodes.append(GraphNode(f"need-{task.name}", Kind.NEED, needs, suspended))
        graph.edges.append(Edge(node, f"need-{task.name}", Relation.NEEDS))


def _task_lines(task: Task) -> tuple[str, ...]:
    kind = {SatisfiedBy.ALL: "compound: all of", SatisfiedBy.ANY: "complex: any of"}[task.satisfied_by]
    own = f"priority {task.priority:g}{', protected' if task.protected else ''}"
    return (task.name, kind if task.subtasks else own)


def _input_edges(task: Task) -> Iterator[Edge]:
    node = f"task-{task.name}"
    for activity in task.activity:
        streams = _read(activity.when, activity.until) | ({activity.stream} if activity.stream else set())
        until = f" until {_line(activity.until)}" if activity.until else ""
        label = activity.initiative or ("" if activity.when == "true" else _line(activity.when)) + until
        contexts = _contexts_read(activity.when, activity.until)
        sources = [f"stream-{stream}" for stream in sorted(streams)] + contexts
        yield from (Edge(source, node, Relation.ACTIVITY, label) for source in sources)
    yield from (Edge(f"task-{name}", node, Relation.CONDITION) for name in task.required_tasks)
    for requirement in task.preconditions:
        read = [f"stream-{stream}" for stream in sorted(_read(requirement.when))]
        for source in read + _contexts_read(requirement.when):
            yield Edge(source, node, Relation.CONDITION, _line(requirement.when))


def _merged(edges: list[Edge]) -> list[Edge]:
    """One arrow, the pre-condition's, where a task's pre-condition is also what makes it active."""
    conditions = {(edge.source, edge.label) for edge in edges if edge.relation is Relation.CONDITION}
    return list(
        dict.fromkeys(
            edge for edge in edges if edge.relation is Relation.CONDITION or (edge.source, edge.label) not in conditions
        )
    )


def _needs(task: Task) -> tuple[str, ...]:
    needs = task.needs
    cores = f"{format_cpu(needs.cores)} {'core' if needs.cores == 1000 else 'cores'}" if needs.cores else ""
    memory = f"{needs.memory / 2**20:.4g} MiB" if needs.memory else ""
    deadline = f"within {needs.deadline:g} s" if needs.deadline else ""
    enforced = "or suspended" if needs.enforce is Enforce.SUSPEND else ""
    return tuple(filter(None, (cores, memory, deadline, enforced)))


def _add_context(graph: Graph, context: Context) -> None:
    node = f"context-{context.name}"
    lines = [context.name, _line(context.when or "by fallback or force")]
    lines += [f"until {_line(context.until)}"] if context.until else []
    graph.nodes.append(GraphNode(node, Kind.CONTEXT, tuple(lines)))
    read = [f"stream-{stream}" for stream in sorted(_read(context.when, context.until))]
    read += _contexts_read(context.when, context.until)
    graph.edges += [Edge(source, node, Relation.READS) for source in read]
    graph.edges += [
        Edge(node, f"task-{task}", Relation.CHANGES, change(effect).replace(" its weight", "").replace(" it", ""))
        for task, effect in context.effects.items()
    ]


def _read(*sources: str | None) -> frozenset[str]:
    """The streams that the expressions read."""
    return frozenset[str]().union(*(shared(source).variables for source in sources if source))


def _contexts_read(*sources: str | None) -> list[str]:
    """The nodes of the contexts that the expressions read."""
    read = frozenset[str]().union(*(shared(source).contexts for source in sources if source))
    return [f"context-{name}" for name in sorted(read)]


def _line(text: str) -> str:
    """The text as one line, without control characters."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in re.sub(r"\s+", " ", text))
