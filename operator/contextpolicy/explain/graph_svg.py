"""A placed graph as SVG, written by hand: no library, and a file that people can diff."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias
from xml.sax.saxutils import escape

from contextpolicy.explain.graph_layout import CHARACTER, LABEL_CHARACTER, LINE, MARGIN, PADDING, label_of, place
from contextpolicy.explain.task_graph import Kind, Relation

if TYPE_CHECKING:
    from contextpolicy.explain.graph_layout import Box, GraphLayout
    from contextpolicy.explain.task_graph import Edge, Graph

    Point: TypeAlias = tuple[float, float]

_FILLS = {
    Kind.STREAM: ("#e8f1f8", "#2a6f97"),
    Kind.TASK: ("#fdf3e7", "#e07a3f"),
    Kind.GROUP: ("#f7e1cf", "#e07a3f"),
    Kind.NEED: ("#f3f3f3", "#999999"),
    Kind.CONTEXT: ("#fdf0c8", "#c99700"),
}
_LINES = {
    Relation.ACTIVITY: ("#2a6f97", 1.3, ""),
    Relation.CONDITION: ("#2a6f97", 2.6, ""),
    Relation.PRODUCES: ("#5b8e55", 1.3, ""),
    Relation.SUBTASK: ("#e07a3f", 1.3, ""),
    Relation.NEEDS: ("#999999", 1.0, "2 2"),
    Relation.READS: ("#c99700", 1.0, "4 3"),
    Relation.CHANGES: ("#c99700", 1.6, "4 3"),
}
_LEGEND = (
    (Relation.ACTIVITY, "makes active"),
    (Relation.CONDITION, "pre-condition"),
    (Relation.PRODUCES, "produces"),
    (Relation.SUBTASK, "subtask"),
    (Relation.CHANGES, "context"),
)
LABEL_HEIGHT = 14.0


def svg(graph: Graph) -> str:
    """The whole picture with a title and a legend."""
    layout = place(graph)
    top, bottom = 44.0, 34.0
    width = max(*(box.x + box.width for box in layout.boxes.values()), 560.0) + MARGIN
    height = max(box.y + box.height for box in layout.boxes.values()) + MARGIN + top + bottom
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" '
        f'height="{height:.0f}" font-family="Helvetica, Arial, sans-serif" font-size="12">'
    )
    parts = [
        head,
        f"<title>{escape(graph.title)}</title>",
        '<rect width="100%" height="100%" fill="white"/>',
        *_markers(),
        f'<text x="{MARGIN:g}" y="30" font-size="17" font-weight="bold">{escape(graph.title)}</text>',
        f'<g transform="translate(0 {top:g})">',
        *(_edge(edge, points) for edge, points in layout.routes.items()),
        *(_node(box) for box in layout.boxes.values()),
        *_labels(layout),
        "</g>",
        *_legend(height - 16),
        "</svg>",
    ]
    return "\n".join(parts)


def _markers() -> list[str]:
    colors = {color for color, _, _ in _LINES.values()}
    return [
        f'<marker id="arrow{color[1:]}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="9" markerHeight="9" '
        f'markerUnits="userSpaceOnUse" orient="auto"><path d="M0 0L8 4L0 8z" fill="{color}"/></marker>'
        for color in sorted(colors)
    ]


def _node(box: Box) -> str:
    node = box.node
    fill, stroke = ("#eeeeee", "#b5495b") if node.suspended else _FILLS[node.kind]
    corner = {Kind.STREAM: box.height / 2, Kind.CONTEXT: 14.0}.get(node.kind, 3.0)
    dash = ' stroke-dasharray="5 3"' if node.suspended else ""
    color = "#888888" if node.suspended else "black"
    outline = f'rx="{corner:g}" fill="{fill}" stroke="{stroke}" stroke-width="1.3"{dash}'
    corners = f'x="{box.x:.1f}" y="{box.y:.1f}" width="{box.width:.1f}" height="{box.height:.1f}"'
    parts = [f"<rect {corners} {outline}/>"]
    for index, line in enumerate(node.lines):
        bold = ' font-weight="bold"' if index == 0 and node.kind is not Kind.NEED else ' fill-opacity="0.75"'
        y = box.y + PADDING / 2 + LINE * (index + 0.75)
        text = f'<text x="{box.x + box.width / 2:.1f}" y="{y:.1f}" text-anchor="middle" fill="{color}"{bold}>'
        parts.append(f"{text}{escape(line)}</text>")
    return "\n".join(parts)


def _edge(edge: Edge, points: list[Point]) -> str:
    color, width, dash = _LINES[edge.relation]
    style = f' stroke-dasharray="{dash}"' if dash else ""
    head = "" if edge.relation is Relation.SUBTASK else f' marker-end="url(#arrow{color[1:]})"'
    start = f"M{points[0][0]:.1f} {points[0][1]:.1f}"
    path = start + "".join(_curve(one, other) for one, other in pairwise(points))
    return f'<path d="{path}" fill="none" stroke="{color}" stroke-width="{width:g}"{style}{head}/>'


def _curve(one: Point, other: Point) -> str:
    """Level at both ends; one that leads back swings over the boxes."""
    (x1, y1), (x2, y2) = one, other
    if x2 > x1:
        bend = (x2 - x1) / 2
        return f"C{x1 + bend:.1f} {y1:.1f} {x2 - bend:.1f} {y2:.1f} {x2:.1f} {y2:.1f}"
    return f"C{x1:.1f} {y1 - 48:.1f} {x2:.1f} {y2 - 48:.1f} {x2:.1f} {y2:.1f}"


def _labels(layout: GraphLayout) -> list[str]:
    """Each beside the head of its arrow, moved down where another one stands already."""
    taken: list[tuple[float, float, float]] = []
    parts = []
    for edge, points in sorted(layout.routes.items(), key=lambda route: route[1][-1][1]):
        if not edge.label:
            continue
        (x1, y1), (x2, y2) = points[-2:]
        width = len(label_of(edge)) * LABEL_CHARACTER
        x, y = (x2 - 16 - width / 2, y2) if x2 > x1 else ((x1 + x2) / 2, (y1 + y2) / 2 - 36)
        while any(abs(x - a) < (width + w) / 2 and abs(y - b) < LABEL_HEIGHT for a, b, w in taken):
            y += LABEL_HEIGHT / 2
        taken.append((x, y, width))
        parts.append(_label(edge, x, y, width))
    return parts


def _label(edge: Edge, x: float, y: float, width: float) -> str:
    return (
        f'<rect x="{x - width / 2:.1f}" y="{y - 7:.1f}" width="{width:.1f}" height="{LABEL_HEIGHT:g}" fill="white" '
        f'fill-opacity="0.85"/><text x="{x:.1f}" y="{y + 4:.1f}" text-anchor="middle" font-size="10.5" '
        f'fill="{_LINES[edge.relation][0]}">{escape(label_of(edge))}<title>{escape(edge.label)}</title></text>'
    )


def _legend(y: float) -> list[str]:
    parts, x = [], MARGIN
    for relation, words in _LEGEND:
        color, width, dash = _LINES[relation]
        parts.append(
            f'<line x1="{x:g}" y1="{y - 4:g}" x2="{x + 26:g}" y2="{y - 4:g}" stroke="{color}" stroke-width="{width:g}" '
            f'stroke-dasharray="{dash or "none"}"/><text x="{x + 32:g}" y="{y:g}" font-size="10.5">{words}</text>'
        )
        x += 50 + len(words) * CHARACTER
    return parts
