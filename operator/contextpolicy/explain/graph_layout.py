"""Where each box stands and how each edge runs: layers from left to right, after Sugiyama.

Every edge that passes a column gets a place of its own in it, so that it runs between the boxes and not behind them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

from contextpolicy.explain.task_graph import Kind, Relation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from contextpolicy.explain.task_graph import Edge, Graph, GraphNode

CHARACTER = 6.7
"""Width of a character of the 12 px font, on average."""
LABEL_CHARACTER = 5.9
LABEL_LENGTH = 36
LINE = 16.0
PADDING = 12.0
NARROWEST_GAP = 70.0
ROW_GAP = 22.0
NEED_GAP = 6.0
MARGIN = 24.0
SWEEPS = 12


@dataclass(slots=True)
class Box:
    """A placed node; x and y are its upper left corner."""

    node: GraphNode
    width: float
    height: float
    x: float = 0.0
    y: float = 0.0


@dataclass(slots=True)
class GraphLayout:
    """Boxes by node id; for each edge the points it runs through, source and target included."""

    boxes: dict[str, Box]
    routes: dict[Edge, list[tuple[float, float]]] = field(default_factory=dict)


def place(graph: Graph) -> GraphLayout:
    """Lay the graph out. A need stands under its task, everything else in its own column."""
    return _Layers(graph).layout()


def label_of(edge: Edge) -> str:
    """An edge's label, cut to what fits between two columns."""
    return edge.label if len(edge.label) <= LABEL_LENGTH else edge.label[: LABEL_LENGTH - 1] + "…"


class _Layers:
    """The steps of one layout."""

    def __init__(self, graph: Graph) -> None:
        self._boxes = {node.id: _box(node) for node in graph.nodes}
        self._needs = {edge.source: edge.target for edge in graph.edges if edge.relation is Relation.NEEDS}
        self._edges = [edge for edge in graph.edges if edge.relation is not Relation.NEEDS]
        self._names = [node.id for node in graph.nodes if node.kind is not Kind.NEED]
        self._ranks = _ranks(self._names, self._edges)
        self._forward = [e for e in self._edges if self._ranks[e.source] < self._ranks[e.target]]
        self._chains = {edge: self._chain(edge) for edge in self._forward}
        self._middles: dict[str, float] = {}
        self._lefts: list[float] = []

    def layout(self) -> GraphLayout:
        columns = self._columns()
        self._place_columns(columns)
        result = GraphLayout(self._boxes)
        ports = self._ports()
        for edge in self._edges:
            result.routes[edge] = self._route(edge, ports) if edge in self._chains else self._detour(edge)
        return result

    def _chain(self, edge: Edge) -> list[str]:
        """The edge's place in each column from source to target."""
        between = range(self._ranks[edge.source] + 1, self._ranks[edge.target])
        return [edge.source, *(f"{id(edge)}@{rank}" for rank in between), edge.target]

    def _columns(self) -> list[list[str]]:
        columns: list[list[str]] = [[] for _ in range(max(self._ranks.values()) + 1)]
        for name in self._names:
            columns[self._ranks[name]].append(name)
        for edge, chain in self._chains.items():
            for offset, name in enumerate(chain[1:-1], start=1):
                columns[self._ranks[edge.source] + offset].append(name)
        return _ordered(columns, [pair for chain in self._chains.values() for pair in pairwise(chain)])

    def _place_columns(self, columns: list[list[str]]) -> None:
        tallest = max(sum(map(self._height, column)) for column in columns)
        x = MARGIN
        for rank, column in enumerate(columns):
            self._lefts.append(x)
            y = MARGIN + (tallest - sum(map(self._height, column))) / 2
            for name in column:
                self._stand(name, x, y)
                y += self._height(name)
            x += max((self._width(name) for name in column), default=0.0) + self._gap(rank + 1)

    def _stand(self, name: str, x: float, y: float) -> None:
        self._middles[name] = y + self._height(name) / 2
        below = y + ROW_GAP / 2
        for own in (name, self._needs.get(name)):
            if own in self._boxes:
                box = self._boxes[own]
                box.x, box.y = x, below
                below += box.height + NEED_GAP
        if name in self._boxes:
            self._middles[name] = self._boxes[name].y + self._boxes[name].height / 2

    def _height(self, name: str) -> float:
        if name not in self._boxes:
            return LINE
        need = self._needs.get(name)
        return self._boxes[name].height + ROW_GAP + (self._boxes[need].height + NEED_GAP if need else 0)

    def _width(self, name: str) -> float:
        return max((self._boxes[own].width for own in (name, self._needs.get(name)) if own in self._boxes), default=0.0)

    def _gap(self, rank: int) -> float:
        """Room for the labels of the edges that end in the column `rank`."""
        labels = [
            len(label_of(e)) * LABEL_CHARACTER + 80 for e in self._forward if self._ranks[e.target] == rank and e.label
        ]
        return max([NARROWEST_GAP, *labels])

    def _ports(self) -> dict[tuple[str, Edge], float]:
        """Where edges touch a box's side: spread over it in the order in which they come, so that they do not merge."""
        ports: dict[tuple[str, Edge], float] = {}
        for name in self._names:
            for end, neighbour in ((0, 1), (-1, -2)):
                own = [edge for edge, chain in self._chains.items() if chain[end] == name]
                own.sort(key=lambda edge: self._middles[self._chains[edge][neighbour]])
                box = self._boxes[name]
                for index, edge in enumerate(own):
                    ports[name, edge] = box.y + box.height * (index + 1) / (len(own) + 1)
        return ports

    def _route(self, edge: Edge, ports: dict[tuple[str, Edge], float]) -> list[tuple[float, float]]:
        source, target = self._boxes[edge.source], self._boxes[edge.target]
        points = [(source.x + source.width, ports[edge.source, edge])]
        if source.width < self._column_width(edge.source):
            points.append((self._lefts[self._ranks[edge.source]] + self._column_width(edge.source), points[0][1]))
        for offset, name in enumerate(self._chains[edge][1:-1], start=1):
            rank = self._ranks[edge.source] + offset
            widest = max(self._width(other) for other in self._names if self._ranks[other] == rank)
            points += [
                (self._lefts[rank] - 8, self._middles[name]),
                (self._lefts[rank] + widest + 8, self._middles[name]),
            ]
        return [*points, (target.x, ports[edge.target, edge])]

    def _column_width(self, name: str) -> float:
        return max(self._width(other) for other in self._names if self._ranks[other] == self._ranks[name])

    def _detour(self, edge: Edge) -> list[tuple[float, float]]:
        """An edge that leads back: out of the top of its source and into the top of its target."""
        source, target = self._boxes[edge.source], self._boxes[edge.target]
        return [(source.x + source.width / 2, source.y), (target.x + target.width / 2, target.y)]


def _box(node: GraphNode) -> Box:
    return Box(node, max(map(len, node.lines)) * CHARACTER + 2 * PADDING, len(node.lines) * LINE + PADDING)


def _ranks(names: Sequence[str], edges: Sequence[Edge]) -> dict[str, int]:
    """The column of each box: right of all that lead to it; edges that close a circle do not count."""
    kept: dict[str, list[str]] = {name: [] for name in names}
    for edge in sorted(edges, key=lambda edge: edge.relation is not Relation.PRODUCES):
        if edge.source != edge.target and not _reaches(kept, edge.target, edge.source):
            kept[edge.source].append(edge.target)
    ranks = dict.fromkeys(names, 0)
    for _ in names:
        for source, targets in kept.items():
            for target in targets:
                ranks[target] = max(ranks[target], ranks[source] + 1)
    return ranks


def _reaches(kept: dict[str, list[str]], start: str, goal: str) -> bool:
    seen, open_ = {start}, [start]
    while open_:
        name = open_.pop()
        if name == goal:
            return True
        following = [other for other in kept[name] if other not in seen]
        seen.update(following)
        open_ += following
    return False


def _ordered(columns: list[list[str]], pairs: Sequence[tuple[str, str]]) -> list[list[str]]:
    """Barycentre sweeps: each place goes to the mean height of its neighbours, which leaves few crossings."""
    near: dict[str, list[str]] = {name: [] for column in columns for name in column}
    for source, target in pairs:
        near[source].append(target)
        near[target].append(source)
    height = {name: (row + 0.5) / len(column) for column in columns for row, name in enumerate(column)}
    for sweep in range(SWEEPS):
        for column in columns if sweep % 2 == 0 else reversed(columns):
            means = {n: sum(height[o] for o in near[n]) / len(near[n]) if near[n] else height[n] for n in column}
            column.sort(key=means.__getitem__)
            height |= {name: (row + 0.5) / len(column) for row, name in enumerate(column)}
    return columns
